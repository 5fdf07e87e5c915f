"""The command line: `isolux solve`, `render`, `info` and `check`.

What a user can mend is one line on stderr and an exit code of the table below, never a traceback.
"""

from __future__ import annotations

from enum import IntEnum
from pathlib import Path
from signal import SIGTERM
from typing import TYPE_CHECKING, Annotated, Any

import typer
from typer.core import TyperGroup

from .errors import IsoluxError, PhotometryError, SceneError, SettingsError

if TYPE_CHECKING:
    from .stage_opening import StageOpening


class ExitCode(IntEnum):
    """How a command ended, and what that means."""

    meaning: str

    def __new__(cls, code: int, meaning: str) -> ExitCode:
        member = int.__new__(cls, code)
        member._value_ = code
        member.meaning = meaning
        return member

    DONE = 0, "done"
    FAILED = 1, "anything else"
    USAGE = 2, "an option or setting that can't be"
    STAGE = 3, "a stage that can't be read or solved, or a file that can't be written"
    PHOTOMETRY = 4, "a photometric file that can't be used"
    INTERRUPTED = 130, "Ctrl-C: the stages so far are kept"
    TERMINATED = 143, "SIGTERM: the stages so far are kept"


_ERROR_CODES: dict[type[IsoluxError], ExitCode] = {
    SettingsError: ExitCode.USAGE,
    SceneError: ExitCode.STAGE,
    PhotometryError: ExitCode.PHOTOMETRY,
}


class _Commands(TyperGroup):
    """Commands whose errors are told in a line."""

    def invoke(self, ctx: Any) -> Any:
        try:
            return super().invoke(ctx)
        except IsoluxError as error:
            message = " ".join(str(error).split())
            typer.echo(f"error: {message}", err=True)
            raise typer.Exit(_ERROR_CODES.get(type(error), ExitCode.FAILED)) from None
        except KeyboardInterrupt:
            typer.echo("interrupted", err=True)
            raise typer.Exit(ExitCode.INTERRUPTED) from None


app = typer.Typer(
    name="isolux",
    cls=_Commands,
    help="Bake physically based global illumination into USD stages.",
    epilog="Exit codes: " + "; ".join(f"{code} {code.meaning}" for code in ExitCode) + ".",
    rich_markup_mode="markdown",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
)


def main() -> None:
    """Entry point of the command `isolux`."""
    app()


def _print_version(wanted: bool) -> None:
    if not wanted:
        return
    from pxr import Usd

    from . import __version__

    usd = ".".join(str(number) for number in Usd.GetVersion()[1:])
    typer.echo(f"isolux {__version__} (USD {usd})")
    raise typer.Exit


@app.callback()
def _isolux(
    version: Annotated[
        bool,
        typer.Option(
            "--version", callback=_print_version, is_eager=True, help="Print the version."
        ),
    ] = False,
) -> None:
    pass


def _usd_path(path: Path | None) -> Path | None:
    """USD knows files by UTF-8 names only."""
    try:
        str(path).encode()
    except UnicodeEncodeError:
        raise typer.BadParameter(f"{str(path)!r} is no name in UTF-8") from None
    return path


_Stage = Annotated[
    Path, typer.Argument(metavar="STAGE", help="USD stage to solve.", callback=_usd_path)
]
_Results = Annotated[
    Path,
    typer.Argument(
        metavar="OUT.usda", help="Results that `isolux solve` wrote.", callback=_usd_path
    ),
]
_ReadTime = Annotated[
    float | None,
    typer.Option(
        "--time", metavar="T", help="Time code to read the stage at; else its startTimeCode."
    ),
]
_Variants = Annotated[
    list[str] | None,
    typer.Option(
        "--variant",
        metavar="/PRIM:SET=VARIANT",
        help="Variant to read and to show in the results; as often as needed.",
    ),
]
_Load = Annotated[
    str | None, typer.Option("--load", metavar="all|none", help="Payloads to load; else all.")
]
_Mask = Annotated[
    list[str] | None,
    typer.Option(
        "--mask",
        metavar="/PRIM",
        help="Open this part alone, with the materials it points to; as often as needed.",
    ),
]


@app.command()
def solve(
    stage: _Stage,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="OUT.usda",
            help="Root layer to write, in the current folder unless given; "
            "the results layer lies beside it.",
            callback=_usd_path,
        ),
    ] = None,
    method: Annotated[
        str | None,
        typer.Option(
            metavar="M", help="auto, composite, dept, ddl+idept or ddl+hpr: see the README."
        ),
    ] = None,
    output_mode: Annotated[
        str | None,
        typer.Option(
            metavar="MODE", help="vertex: meshes as they are; refined: with the adaptive mesh."
        ),
    ] = None,
    instances: Annotated[
        str | None,
        typer.Option(
            metavar="HOW",
            help="expand: a prim of each instance, with its own primvars; "
            "summary: instances stay, one value each.",
        ),
    ] = None,
    photons: Annotated[
        int | None, typer.Option(metavar="N", help="Stop at so many photons.")
    ] = None,
    time_budget: Annotated[
        float | None, typer.Option(metavar="S", help="Stop after so many seconds of solving.")
    ] = None,
    target_error: Annotated[
        float | None,
        typer.Option(metavar="E", help="Stop at this relative RMS error: 0.05, not 5 %."),
    ] = None,
    seed: Annotated[int | None, typer.Option(metavar="N", help="Of the random numbers.")] = None,
    threads: Annotated[
        int | None, typer.Option(metavar="N", help="Processors to use; 0: all.")
    ] = None,
    stages: Annotated[
        int | None, typer.Option(metavar="N", help="Number of progressive stages.")
    ] = None,
    display_view: Annotated[
        str | None,
        typer.Option(
            metavar="VIEW",
            help="What displayColor is seen by: tumblin-rushmeier, or DISPLAY/VIEW of the "
            "OpenColorIO configuration in OCIO, else of the built-in ACES.",
        ),
    ] = None,
    preview: Annotated[
        bool,
        typer.Option(
            "--preview",
            help="Write OUT.preview.usda too: every baked mesh shines with its displayColor, "
            "so that a viewer shows the bake and not the materials.",
        ),
    ] = False,
    time: _ReadTime = None,
    frames: Annotated[
        str | None,
        typer.Option(
            metavar="A:B[:S]",
            help="Solve at each time code from A to B, in steps of S, for playback.",
        ),
    ] = None,
    variant: _Variants = None,
    load: _Load = None,
    mask: _Mask = None,
    replay: Annotated[
        Path | None,
        typer.Option(
            metavar="RESULTS",
            help="Make an earlier run again, bit for bit, by the settings and counts it recorded.",
        ),
    ] = None,
    report: Annotated[
        Path | None, typer.Option(metavar="FILE.json", help="Write the run's report as JSON.")
    ] = None,
) -> None:
    """Bake the illumination of STAGE, stage by progressive stage.

    Settings come from the stage's RenderSettings prim; options override them. At most one of
    --photons, --time-budget and --target-error. Ctrl-C keeps what was computed; Ctrl-C again stops
    at once.
    """
    from .solve_command import solve_stage
    from .stage_opening import StageOpening

    opening = StageOpening.parse(variant or (), load, mask or ())
    options = {
        "method": method,
        "output_mode": output_mode,
        "instances": instances,
        "photons": photons,
        "time_budget": time_budget,
        "target_error": target_error,
        "seed": seed,
        "threads": threads,
        "stages": stages,
        "display_view": display_view,
    }
    output = output or Path(f"{stage.stem}.isolux.usda")
    if frames is not None:
        _solve_frames(stage, output, options, frames, time, replay, report, opening, preview)
        return
    ended_by = solve_stage(stage, output, options, time, report, replay, preview, opening)
    if ended_by is not None:
        raise typer.Exit(ExitCode.TERMINATED if ended_by == SIGTERM else ExitCode.INTERRUPTED)


def _solve_frames(
    stage: Path,
    output: Path,
    options: dict[str, Any],
    frames: str,
    time: float | None,
    replay: Path | None,
    report: Path | None,
    opening: StageOpening,
    preview: bool,
) -> None:
    from .frames_command import parse_frames, solve_frames

    for name, value in (("--time", time), ("--replay", replay)):
        if value is not None:
            raise SettingsError("--frames", f"{name} beside it", "one of them")
    outcome = solve_frames(stage, output, options, parse_frames(frames), report, opening, preview)
    if outcome.signal is not None:
        terminated = outcome.signal == SIGTERM
        raise typer.Exit(ExitCode.TERMINATED if terminated else ExitCode.INTERRUPTED)
    if outcome.failures:
        raise typer.Exit(_ERROR_CODES.get(type(outcome.failures[0]), ExitCode.FAILED))


@app.command()
def render(
    results: _Results,
    output: Annotated[
        Path | None,
        typer.Option(
            "-o",
            "--output",
            metavar="x.png|x.exr",
            help="Picture to write, a PNG in the current folder unless given; EXR keeps cd/m².",
        ),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="PATH", help="Camera prim; else the stage's first, or one framed on the room."
        ),
    ] = None,
    time: Annotated[
        float | None, typer.Option(metavar="T", help="Progressive stage to show; else the last.")
    ] = None,
    width: Annotated[int, typer.Option(metavar="W", help="Pixels.")] = 960,
    samples: Annotated[int, typer.Option(metavar="N", help="Rays a pixel.")] = 4,
    exposure: Annotated[
        float | None,
        typer.Option(metavar="EV", help="At ISO 100; else by the picture's log-average."),
    ] = None,
) -> None:
    """Make a picture of baked results; no light is traced."""
    from .image_io import check_picture, write_picture
    from .render import render_picture
    from .solve_command import require_place
    from .stage_opening import open_stage

    output = output or Path(f"{results.stem}.png")
    check_picture(output, exposure)
    require_place(output)
    picture = render_picture(
        open_stage(results), camera=camera, time=time, width=width, samples=samples
    )
    used = write_picture(picture, output, exposure)
    height, width = picture.coverage.shape
    facts = [f"{width} × {height}", f"camera {picture.camera or 'framed on the interior'}"]
    if picture.time is not None:
        facts.append(f"stage {picture.time:g}")
    facts.append("cd/m²" if used is None else f"exposure {used:.2f} EV")
    typer.echo(f"{output}: {', '.join(facts)}")


@app.command()
def info(results: _Results) -> None:
    """Show what results tell about themselves: stages, provenance, primvars."""
    from .report import read_report
    from .tables import field_table, new_console, provenance_table, stage_table

    provenance, stages = read_report(results)
    console = new_console()
    console.print(stage_table(stages))
    console.print(field_table())
    console.print(provenance_table(provenance))


@app.command()
def check(
    stage: _Stage,
    time: _ReadTime = None,
    variant: _Variants = None,
    load: _Load = None,
    mask: _Mask = None,
) -> None:
    """Show what `solve` would read of STAGE, what it would skip, and what is wrong.

    USD's own validators have their say, and so have those of Isolux; their errors are told, and
    change nothing in how the command ends: as `solve` would.
    """
    from .dark_stages import what_is_dark
    from .interrupt import signals_held
    from .settings import settings_from_stage
    from .solve_command import print_warnings
    from .stage_check import check_stage
    from .stage_opening import StageOpening, open_stage
    from .stage_reader import read_source
    from .tables import (
        complaint_table,
        findings_table,
        luminaire_table,
        new_console,
        prims_table,
        scene_summary,
    )

    opening = StageOpening.parse(variant or (), load, mask or ())
    console = new_console()
    opened = open_stage(stage, opening)
    with signals_held():
        checked = check_stage(opened)
    if checked.complaints:
        console.print(complaint_table(checked.complaints))
    for reason, count in checked.left_out.items():
        console.print(f"left out: {count} × {reason}", soft_wrap=True)
    _, scene, _ = read_source(stage, time, settings_from_stage, opening)
    if scene.luminaires:
        console.print(luminaire_table(scene.luminaires))
    dark = what_is_dark(scene)
    findings = (*scene.findings, dark) if dark else scene.findings
    if findings:
        console.print(findings_table(findings))
    if scene.prim_counts:
        console.print(prims_table(scene))
    console.print(f"{stage}: {scene_summary(scene)}", soft_wrap=True)
    print_warnings(new_console(stderr=True), findings, stage)
