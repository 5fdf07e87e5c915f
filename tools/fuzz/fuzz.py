"""Odd files for the readers, for some time; new ways through the code are what it looks for.

    python -m tools.fuzz.fuzz photometry --seconds 60

Stops at the first finding (an exception that is no IsoluxError, a promise broken, a crash, more
than a few seconds or a few gigabytes), and leaves the file in build/fuzz/. Once it is mended, the
file goes to tests/fuzz/corpus/, which the tests read again. Files that came by new ways are kept
in build/fuzz/ for the next run.
"""

from __future__ import annotations

import argparse
import gc
import sys
import tempfile
import time
from pathlib import Path
from types import FunctionType

import atheris
from tools.fuzz.odd_text import OddText
from tools.fuzz.targets import CORPUS, TARGETS

LONGEST_FILE = 16_384  # bytes
LONGEST_RUN = 10  # s of CPU for one file, however busy the machine
LONGEST_WAIT = 120  # s of wall-clock time: it hangs
LARGEST_RUN = 3072  # MB in all


def watch_ways() -> None:
    """Have the ways through our own functions counted: an editable install hides their imports."""
    for function in gc.get_objects():
        if isinstance(function, FunctionType) and str(function.__module__).startswith("isolux."):
            atheris.instrument_func(function)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("target", choices=TARGETS)
    parser.add_argument("--seconds", type=int, default=60)
    chosen = parser.parse_args()

    watch_ways()
    kept = CORPUS / chosen.target
    found = Path("build") / "fuzz" / chosen.target
    found.mkdir(parents=True, exist_ok=True)
    odd = OddText(file.read_text(encoding="latin-1") for file in sorted(kept.iterdir()))
    read = TARGETS[chosen.target]

    def change(content: bytes, longest: int, seed: int) -> bytes:
        if seed % 8 == 0:
            return atheris.Mutate(content, longest)
        return odd.change(content.decode("latin-1"), seed).encode("latin-1")[:longest]

    def try_file(content: bytes) -> None:
        begun = time.process_time()
        try:
            read(content, Path(folder))
            taken = time.process_time() - begun
            assert taken < LONGEST_RUN, f"took {taken:.0f} s"
        except BaseException:  # libFuzzer writes it later, unless what ends Python ends that too
            Path(f"build/fuzz/{chosen.target}_finding").write_bytes(content)
            raise

    with tempfile.TemporaryDirectory(prefix="isolux_fuzz_") as folder:
        options = {
            "max_total_time": chosen.seconds,
            "max_len": LONGEST_FILE,
            "timeout": LONGEST_WAIT,
            "rss_limit_mb": LARGEST_RUN,
            "artifact_prefix": f"build/fuzz/{chosen.target}_",
            "print_final_stats": 1,
        }
        atheris.Setup(
            [
                sys.argv[0],
                *(f"-{name}={value}" for name, value in options.items()),
                str(found),
                str(kept),
            ],
            try_file,
            custom_mutator=change,
        )
        atheris.Fuzz()


if __name__ == "__main__":
    main()
