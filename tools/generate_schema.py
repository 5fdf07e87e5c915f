"""Write schema/generated/ from schema/schema.usda with usd-core's own usdGenSchema.

python tools/generate_schema.py            write the generated files
python tools/generate_schema.py --check    exit 1 where they differ from their source
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

from pxr import Usd

SCHEMA = Path(__file__).resolve().parents[1] / "schema"
SOURCE = SCHEMA / "schema.usda"
GENERATED = SCHEMA / "generated"

# usdGenSchema leaves these to a C++ build. Unfilled, USD registers the types but finds no
# generatedSchema.usda: the API can be applied and every attribute reads None.
PLUG_INFO_PLACEHOLDERS = {
    "@PLUG_INFO_LIBRARY_PATH@": "",
    "@PLUG_INFO_RESOURCE_PATH@": ".",
    "@PLUG_INFO_ROOT@": ".",
}


def generate(folder: Path) -> None:
    """Write plugInfo.json and generatedSchema.usda into an empty folder."""
    generator = Path(Usd.__file__).parent / "usdGenSchema.py"
    command = [sys.executable, str(generator), "--quiet", str(SOURCE), str(folder)]
    subprocess.run(command, check=True, capture_output=True, text=True)
    plug_info = folder / "plugInfo.json"
    text = plug_info.read_text()
    for placeholder, value in PLUG_INFO_PLACEHOLDERS.items():
        text = text.replace(placeholder, value)
    plug_info.write_text(text)


def contents(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in sorted(folder.iterdir())}


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--check", action="store_true", help="compare instead of writing")
    check = parser.parse_args().check
    with tempfile.TemporaryDirectory() as temporary:
        try:
            generate(Path(temporary))
        except subprocess.CalledProcessError as error:
            print(f"{SOURCE}: usdGenSchema failed\n{error.stderr}", file=sys.stderr)
            return 1
        fresh = contents(Path(temporary))
    if check:
        if fresh == contents(GENERATED):
            return 0
        print(f"{GENERATED} is not what {SOURCE} gives; run {Path(__file__).name}", file=sys.stderr)
        return 1
    GENERATED.mkdir(exist_ok=True)
    for name, content in fresh.items():
        (GENERATED / name).write_bytes(content)
    return 0


if __name__ == "__main__":
    sys.exit(main())
