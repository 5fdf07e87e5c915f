# ruff: noqa: E501  (stages as their text)
"""Stages that no exporter should write, each with what a reader must say of it.

Each case writes its files into a folder. Expected is either a stage that is solved all the same,
with findings at given prims, or an exit code with words of the error line.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from small_room import FLOOR, LAMP, WALLS

HEADER = '#usda 1.0\n(\n    metersPerUnit = 1\n    upAxis = "Z"\n)\n'


@dataclass(frozen=True, slots=True)
class Hostile:
    """One stage.

    files : name to text or bytes; the stage is stage.usda or the only one
    findings : (path, action) of those that may not be missing
    error : words of the error line; empty: the stage is solved
    code : exit code of the command
    dark : words of the warning that the results are empty
    """

    files: Mapping[str, str | bytes]
    findings: tuple[tuple[str, str], ...] = ()
    error: tuple[str, ...] = ()
    code: int = 0
    dark: str = ""


def stage(*prims: str, header: str = HEADER, **files: str | bytes) -> dict[str, str | bytes]:
    body = 'def Xform "World" {\n' + "".join(prims) + "}\n"
    return {"stage.usda": header + body} | {
        name.replace("__", "."): contents for name, contents in files.items()
    }


def room(*prims: str, header: str = HEADER, **files: str | bytes) -> dict[str, str | bytes]:
    """A room that can be solved, with more prims in it."""
    return stage(FLOOR, WALLS, LAMP, *prims, header=header, **files)


def mesh(name: str = "Odd", **attributes: str) -> str:
    """A triangle; each attribute replaces its line, or adds one."""
    lines = {
        "faceVertexCounts": "int[] faceVertexCounts = [3]",
        "faceVertexIndices": "int[] faceVertexIndices = [0, 1, 2]",
        "points": "point3f[] points = [(0, 0, 1), (1, 0, 1), (0, 1, 1)]",
        "scheme": 'uniform token subdivisionScheme = "none"',
    } | attributes
    body = "\n".join(f"        {line}" for line in lines.values())
    return f'    def Mesh "{name}" {{\n{body}\n    }}\n'


def lamp(name: str = "Odd", kind: str = "SphereLight", body: str = "") -> str:
    return f'    def {kind} "{name}" {{\n        {body}\n    }}\n'


def applied(name: str, api: str, body: str, kind: str = "SphereLight") -> str:
    return (
        f'    def {kind} "{name}" ( prepend apiSchemas = ["{api}"] ) {{\n        {body}\n    }}\n'
    )


ODD = "/World/Odd"
SKIPPED = ((ODD, "skipped"),)
REPAIRED = ((ODD, "repaired"),)
MANY = 200_000  # entries of arrays that are far too long


def wrong_arrays() -> dict[str, Hostile]:
    """Meshes whose arrays don't fit together."""
    bad = {
        "a negative index": {"faceVertexIndices": "int[] faceVertexIndices = [0, 1, -1]"},
        "an index of 10^9": {"faceVertexIndices": "int[] faceVertexIndices = [0, 1, 1000000000]"},
        "too few indices": {"faceVertexIndices": "int[] faceVertexIndices = [0, 1]"},
        "too many indices": {"faceVertexIndices": "int[] faceVertexIndices = [0, 1, 2, 0]"},
        "no indices": {"faceVertexIndices": "int[] faceVertexIndices = []"},
        "a negative count": {"faceVertexCounts": "int[] faceVertexCounts = [-3]"},
        "counts that cancel out": {"faceVertexCounts": "int[] faceVertexCounts = [6, -3]"},
        "counts beyond 2^31": {
            "faceVertexCounts": "int[] faceVertexCounts = [2147483647, 2147483647, 5]"
        },
        "one face of 2^31 corners": {"faceVertexCounts": "int[] faceVertexCounts = [2147483647]"},
        "no counts": {"faceVertexCounts": ""},
        "counts of 0": {
            "faceVertexCounts": "int[] faceVertexCounts = [0, 0]",
            "faceVertexIndices": "int[] faceVertexIndices = []",
        },
        "no points": {"points": "point3f[] points = []"},
        "no points attribute": {"points": ""},
        "points of None": {"points": "point3f[] points = None"},
        "points that are NaN": {"points": "point3f[] points = [(0, 0, 1), (1, nan, 1), (0, 1, 1)]"},
        "points that are infinite": {
            "points": "point3f[] points = [(0, 0, 1), (inf, 0, 1), (0, 1, 1)]"
        },
        "points of text": {"points": 'string[] points = ["a", "b", "c"]'},
        "points of two numbers": {"points": "float2[] points = [(0, 0), (1, 0), (0, 1)]"},
        "points of one number": {"points": "float[] points = [0, 1, 2]"},
        "one point without an array": {"points": "point3f points = (1, 2, 3)"},
        "indices of text": {"faceVertexIndices": 'string[] faceVertexIndices = ["0", "1", "2"]'},
        "indices of fractions": {
            "faceVertexIndices": "float[] faceVertexIndices = [0.5, 1.5, 2.5]"
        },
        "indices of fractions that are NaN": {
            "faceVertexIndices": "float[] faceVertexIndices = [nan, 1, 2]"
        },
        "indices of 64 bits": {
            "faceVertexIndices": "int64[] faceVertexIndices = [0, 1, 4294967298]"
        },
        "counts of one number": {"faceVertexCounts": "int faceVertexCounts = 3"},
        "counts that are a time code": {"faceVertexCounts": "timecode[] faceVertexCounts = [3]"},
        "points so far that they have no area": {
            "points": "point3f[] points = [(1e38, 0, 1), (3e38, 0, 1), (0, 3e38, 1)]"
        },
    }
    return {
        f"a mesh with {name}": Hostile(room(mesh(**lines)), SKIPPED) for name, lines in bad.items()
    }


def odd_attributes() -> dict[str, Hostile]:
    """Meshes that can be read without the attribute that can't."""
    triangles = "[(0, 0, 1), (0, 0, 1), (0, 0, 1)]"
    bad = {
        "normals of NaN": "normal3f[] normals = [(nan, 0, 1), (0, 0, 1), (0, 0, 1)]",
        "normals of zero": "normal3f[] normals = [(0, 0, 0), (0, 0, 0), (0, 0, 0)]",
        "too few normals": 'normal3f[] normals = [(0, 0, 1)] (interpolation = "vertex")',
        "normals of text": 'string[] normals = ["up"]',
        "normals of no known interpolation": f'normal3f[] normals = {triangles} (interpolation = "face")',
        "indexed normals out of range": f'normal3f[] primvars:normals = {triangles} (interpolation = "vertex")\n int[] primvars:normals:indices = [0, 1, 99]',
        "negative indices of normals": f'normal3f[] primvars:normals = {triangles} (interpolation = "vertex")\n int[] primvars:normals:indices = [0, 1, -99]',
        "too few colours": 'color3f[] primvars:displayColor = [(0.5, 0.5, 0.5)] (interpolation = "vertex")',
        "colours of text": 'string[] primvars:displayColor = ["red"]',
        "indexed colours out of range": 'color3f[] primvars:displayColor = [(0.5, 0.5, 0.5)] (interpolation = "vertex")\n int[] primvars:displayColor:indices = [0, 1000000000, 0]',
        "hole indices out of range": "int[] holeIndices = [-1, 1000000000]",
        "hole indices of text": 'string[] holeIndices = ["0"]',
    }
    cases = {
        f"a mesh with {name}": Hostile(room(mesh(odd=line)), REPAIRED) for name, line in bad.items()
    }
    quiet = {
        "a subdivision scheme of no name": 'uniform token subdivisionScheme = "garbage"',
        "an orientation of no name": 'uniform token orientation = "inwards"',
        "double-sidedness of text": 'string doubleSided = "yes"',
        "a visibility of no name": 'token visibility = "perhaps"',
        "a purpose of no name": 'uniform token purpose = "decoration"',
        "an extent of NaN": "float3[] extent = [(nan, nan, nan), (inf, inf, inf)]",
        "creases out of range": "int[] creaseIndices = [0, 1000000000]\n int[] creaseLengths = [2]\n float[] creaseSharpnesses = [10]",
        "corners out of range": "int[] cornerIndices = [-7]\n float[] cornerSharpnesses = [nan]",
        "skinning that leads nowhere": "int[] primvars:skel:jointIndices = [0, 99, -1]\n rel skel:skeleton = </Nobody>",
        "a material that isn't there": "rel material:binding = </World/Nobody>",
        "a material that is a mesh": "rel material:binding = </World/Floor>",
    }
    return cases | {
        f"a mesh with {name}": Hostile(room(mesh(odd=line))) for name, line in quiet.items()
    }


def transforms() -> dict[str, Hostile]:
    order = 'uniform token[] xformOpOrder = ["xformOp:transform"]'
    bad = {
        "NaN": "matrix4d xformOp:transform = ((nan, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))",
        "infinity": "matrix4d xformOp:transform = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (inf, 0, 0, 1))",
        "no third axis": "matrix4d xformOp:transform = ((1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 0, 0), (0, 0, 0, 1))",
        "a perspective": "matrix4d xformOp:transform = ((1, 0, 0, 0.5), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1))",
        "all zeros": "matrix4d xformOp:transform = ((0, 0, 0, 0), (0, 0, 0, 0), (0, 0, 0, 0), (0, 0, 0, 0))",
        "a scale of 1e300": "matrix4d xformOp:transform = ((1e300, 0, 0, 0), (0, 1e300, 0, 0), (0, 0, 1e300, 0), (0, 0, 0, 1))",
    }
    cases = {
        f"a mesh under {name}": Hostile(room(mesh(odd=line, order=order)), SKIPPED)
        for name, line in bad.items()
    } | {
        f"a light under {name}": Hostile(
            room(lamp(body=f"{line}\n {order}")),
            (("/World/Odd", "approximated"),) if name == "no third axis" else SKIPPED,
        )
        for name, line in bad.items()
    }
    quiet = {
        "an operation of no name": 'uniform token[] xformOpOrder = ["xformOp:wobble"]',
        "an operation that isn't authored": 'uniform token[] xformOpOrder = ["xformOp:translate"]',
        "an order of numbers": "int[] xformOpOrder = [1, 2]",
        "a translation of text": 'string xformOp:translate = "left"\n uniform token[] xformOpOrder = ["xformOp:translate"]',
        "the same operation 3 times": 'double3 xformOp:translate = (0, 0, 0.1)\n uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:translate", "xformOp:translate"]',
    }
    return cases | {
        f"a mesh under {name}": Hostile(room(mesh(odd=line))) for name, line in quiet.items()
    }


def lights() -> dict[str, Hostile]:
    wrong = {
        "an intensity of NaN": "float inputs:intensity = nan",
        "an infinite intensity": "float inputs:intensity = inf",
        "an intensity of text": 'string inputs:intensity = "bright"',
        "an exposure of 1e30": "float inputs:exposure = 1e30",
        "an exposure of 1000": "float inputs:exposure = 1000",
        "a colour of NaN": "color3f inputs:color = (nan, 1, 1)",
        "a negative colour": "color3f inputs:color = (-1, -1, -1)",
        "a colour of one number": "float inputs:color = 1",
        "a radius of NaN": "float inputs:radius = nan",
        "a negative radius": "float inputs:radius = -1",
        "an infinite radius": "float inputs:radius = inf",
        "a radius of text": 'string inputs:radius = "big"',
        "a colour temperature of NaN": "bool inputs:enableColorTemperature = 1\n float inputs:colorTemperature = nan",
    }
    dark = {
        "a negative intensity": "float inputs:intensity = -1",
        "a radius of 1e38": "float inputs:radius = 1e38",
    }
    return {
        f"a light with {name}": Hostile(room(lamp(body=line)), error=(ODD,), code=3)
        for name, line in wrong.items()
    } | {
        f"a light with {name}": Hostile(room(lamp(body=line)), SKIPPED)
        for name, line in dark.items()
    }


def old_lights() -> dict[str, Hostile]:
    """UsdLux before 21.02: inputs without their prefix."""
    body = "float intensity = 3000\n float radius = 0.2\n color3f color = (1, 0.5, 0.5)"
    return {
        "a light of the time before inputs": Hostile(room(lamp(body=body)), SKIPPED),
    }


def arcs() -> dict[str, Hostile]:
    child = '#usda 1.0\n( defaultPrim = "Box" )\ndef Xform "Box" ( references = @./stage.usda@</World> ) { }\n'
    return {
        "a reference to itself": Hostile(
            room('    def "Odd" ( references = </World/Odd> ) { }\n'), SKIPPED
        ),
        "a reference to its parent": Hostile(
            room('    def "Odd" ( references = </World> ) { }\n'), SKIPPED
        ),
        "a cycle of two files": Hostile(
            room('    def "Odd" ( references = @./child.usda@ ) { }\n', child__usda=child),
            (("/World/Odd/Odd", "skipped"),),
        ),
        "a cycle of payloads": Hostile(
            room(
                '    def "Odd" ( payload = @./child.usda@ ) { }\n',
                child__usda=child.replace("references", "payload"),
            ),
            (("/World/Odd/Odd", "skipped"),),
        ),
        "a cycle of inherits": Hostile(
            room(
                '    def "Odd" ( inherits = </World/Other> ) { }\n    def "Other" ( inherits = </World/Odd> ) { }\n'
            ),
            (),
        ),
        "a cycle of specializes": Hostile(
            room('    def "Odd" ( specializes = </World/Odd/Inner> ) {\n def "Inner" { }\n }\n'),
            SKIPPED,
        ),
        "a missing reference": Hostile(
            room('    def "Odd" ( references = @./nobody.usda@ ) { }\n'), SKIPPED
        ),
        "a missing payload": Hostile(
            room('    def "Odd" ( payload = @./nobody.usda@ ) { }\n'), SKIPPED
        ),
        "a reference to no prim": Hostile(
            room('    def "Odd" ( references = @./child.usda@</Nobody> ) { }\n', child__usda=child),
            SKIPPED,
        ),
        "a reference to no stage": Hostile(
            room(
                '    def "Odd" ( references = @./child.usda@ ) { }\n', child__usda="no stage at all"
            ),
            SKIPPED,
        ),
        **{
            f"a reference to {kind} of noise": Hostile(
                room(
                    f'    def "Odd" ( references = @./child{suffix}@ ) {{ }}\n',
                    **{f"child_{suffix}".replace("_.", "__"): start + bytes(range(256)) * 4},
                ),
                SKIPPED,
            )
            for kind, suffix, start in (
                ("a crate", ".usdc", b"PXR-USDC\x00\x0d\x00\x00"),
                ("a package", ".usdz", b"PK\x03\x04"),
                ("text", ".usda", b"#usda 1.0\n"),
            )
        },
        "a missing sublayer": Hostile(
            room(header=HEADER.replace("(\n", "(\n    subLayers = [@./nobody.usda@]\n", 1)),
            (("/", "skipped"),),
        ),
        "itself as a sublayer": Hostile(
            room(header=HEADER.replace("(\n", "(\n    subLayers = [@./stage.usda@]\n", 1)),
            (("/", "skipped"),),
        ),
        "an instance of itself": Hostile(
            room('    def "Odd" ( instanceable = true\n references = </World> ) { }\n'), SKIPPED
        ),
    }


def networks() -> dict[str, Hostile]:
    def material(body: str) -> str:
        return (
            f'    def Material "Paint" {{\n        token outputs:surface.connect = </World/Paint/Surface.outputs:surface>\n{body}    }}\n'
            + mesh(odd="rel material:binding = </World/Paint>").replace(
                '"Odd" {', '"Odd" ( prepend apiSchemas = ["MaterialBindingAPI"] ) {'
            )
        )

    surface = '        def Shader "Surface" {{\n uniform token info:id = "UsdPreviewSurface"\n {}\n token outputs:surface\n }}\n'
    bad = {
        "an input connected to itself": surface.format(
            "color3f inputs:diffuseColor.connect = </World/Paint/Surface.inputs:diffuseColor>"
        ),
        "inputs in a circle": surface.format(
            "color3f inputs:diffuseColor.connect = </World/Paint.inputs:a>"
        )
        + " color3f inputs:a.connect = </World/Paint.inputs:b>\n color3f inputs:b.connect = </World/Paint.inputs:a>\n",
        "an input connected to nowhere": surface.format(
            "color3f inputs:diffuseColor.connect = </Nobody.outputs:rgb>"
        ),
        "a colour of text": surface.format('string inputs:diffuseColor = "red"'),
        "a surface that isn't there": "",
        "a surface without an id": '        def Shader "Surface" {\n token outputs:surface\n }\n',
        "a texture without a file": surface.format(
            "color3f inputs:diffuseColor.connect = </World/Paint/Texture.outputs:rgb>"
        )
        + ' def Shader "Texture" {\n uniform token info:id = "UsdUVTexture"\n asset inputs:file = @./nobody.png@\n float3 outputs:rgb\n }\n',
        "a texture that is no picture": surface.format(
            "color3f inputs:diffuseColor.connect = </World/Paint/Texture.outputs:rgb>"
        )
        + ' def Shader "Texture" {\n uniform token info:id = "UsdUVTexture"\n asset inputs:file = @./stage.usda@\n float3 outputs:rgb\n }\n',
        "a texture that is a folder": surface.format(
            "color3f inputs:diffuseColor.connect = </World/Paint/Texture.outputs:rgb>"
        )
        + ' def Shader "Texture" {\n uniform token info:id = "UsdUVTexture"\n asset inputs:file = @.@\n float3 outputs:rgb\n }\n',
        "a texture scaled by NaN": surface.format(
            "color3f inputs:diffuseColor.connect = </World/Paint/Texture.outputs:rgb>"
        )
        + ' def Shader "Texture" {\n uniform token info:id = "UsdUVTexture"\n asset inputs:file = @./nobody.png@\n float4 inputs:fallback = (0.5, 0.5, 0.5, 1)\n string inputs:scale = "x"\n float3 outputs:rgb\n }\n',
    }
    cases = {f"a material with {name}": Hostile(room(material(body))) for name, body in bad.items()}
    wrong = {
        "a colour of NaN": ("color3f inputs:diffuseColor = (nan, 0, 0)", "/World/Paint/Surface"),
        "a negative colour": ("color3f inputs:diffuseColor = (-1, 0, 0)", "/World/Paint/Surface"),
        "an infinite colour": ("color3f inputs:diffuseColor = (inf, 0, 0)", "/World/Paint/Surface"),
    }
    cases |= {
        f"a material with {name}": Hostile(
            room(material(surface.format(line))), error=(path,), code=3
        )
        for name, (line, path) in wrong.items()
    }
    subset = mesh().replace(
        "\n    }\n",
        '\n        def GeomSubset "Part" ( prepend apiSchemas = ["MaterialBindingAPI"] ) { uniform token elementType = "face"\n uniform token familyName = "materialBind"\n LINE\n }\n    }\n',
    )
    cases |= {
        f"a subset with {name}": Hostile(
            room(subset.replace("LINE", line)), (("/World/Odd/Part", "repaired"),)
        )
        for name, line in {
            "indices out of range": "int[] indices = [0, -1, 1000000000]",
            "indices of text": 'string[] indices = ["all"]',
        }.items()
    }
    collection = 'prepend apiSchemas = ["CollectionAPI:paint", "MaterialBindingAPI"]'
    cases["a collection that includes itself"] = Hostile(
        room(
            f'    def "Odd" ( {collection} ) {{\n rel collection:paint:includes = </World/Odd.collection:paint>\n rel material:binding:collection:paint = [</World/Odd.collection:paint>, </World/Paint>]\n {mesh()} }}\n'
        )
    )
    return cases


def metadata() -> dict[str, Hostile]:
    def with_(line: str) -> dict[str, str | bytes]:
        return room(header=HEADER.replace("    metersPerUnit = 1\n", line))

    units = {
        "zero": "0",
        "negative": "-1",
        "NaN": "nan",
        "infinite": "inf",
        "of 1e-40": "1e-40",
        "of 1e200": "1e200",
    }
    cases = {
        f"metersPerUnit {name}": Hostile(
            with_(f"    metersPerUnit = {value}\n"), error=("metersPerUnit",), code=3
        )
        for name, value in units.items()
    }
    return cases | {
        "metersPerUnit of 1e30": Hostile(
            with_("    metersPerUnit = 1e30\n"),
            (("/World/Floor", "skipped"),),
            dark="no visible mesh",
        ),
        "upAxis garbage": Hostile(room(header=HEADER.replace('"Z"', '"Q"')), (("/", "repaired"),)),
        "start of NaN": Hostile(
            with_("    metersPerUnit = 1\n    startTimeCode = nan\n    endTimeCode = nan\n")
        ),
        "infinite rate": Hostile(with_("    metersPerUnit = 1\n    timeCodesPerSecond = inf\n")),
        "no rate": Hostile(with_("    metersPerUnit = 1\n    timeCodesPerSecond = 0\n")),
        "render settings that lead nowhere": Hostile(
            with_('    metersPerUnit = 1\n    renderSettingsPrimPath = "/Nobody"\n'),
            error=("/Nobody",),
            code=2,
        ),
        "render settings of no path": Hostile(
            with_('    metersPerUnit = 1\n    renderSettingsPrimPath = "no path//"\n'),
            error=("no path//",),
            code=2,
        ),
        "included purposes of numbers": Hostile(
            room(
                '    def RenderSettings "Odd" { uniform int[] includedPurposes = [1, 2] }\n',
                header=HEADER.replace(")", '    renderSettingsPrimPath = "/World/Odd"\n)'),
            ),
            error=(ODD, "includedPurposes"),
            code=3,
        ),
        "a default prim that isn't there": Hostile(
            with_('    metersPerUnit = 1\n    defaultPrim = "Nobody"\n')
        ),
        "samples at a time of NaN": Hostile(
            room(mesh(points="point3f[] points.timeSamples = { nan: [(0, 0, 1)] }"))
        ),
    }


def sizes() -> dict[str, Hostile]:
    deep = 400  # crates take USD time with the cube of the depth
    nested = "".join(f'def Xform "L{i}" {{\n' for i in range(deep)) + mesh() + "}\n" * deep
    wide = "".join(mesh(f"M{i}") for i in range(100))
    return {
        "nothing": Hostile({"stage.usda": "#usda 1.0\n"}, dark="no visible mesh"),
        "a comment that is not UTF-8": Hostile(
            {"stage.usda": b"#usda 1.0\n# caf\xe9\n"}, error=("stage.usda", "UTF-8"), code=3
        ),
        "an empty file": Hostile({"stage.usda": ""}, error=("stage.usda",), code=3),
        "names of other scripts": Hostile(room(mesh("Ωmesh_名前"))),
        "a name of 50,000 letters": Hostile(room(mesh("a" * 50_000))),
        "prims 400 deep": Hostile(room(nested)),
        "100 meshes": Hostile(room(wide)),
        "a face of 200 thousand corners": Hostile(
            room(
                mesh(
                    faceVertexCounts=f"int[] faceVertexCounts = [{MANY}]",
                    faceVertexIndices="int[] faceVertexIndices = ["
                    + ", ".join(str(i % 3) for i in range(MANY))
                    + "]",
                )
            ),
            REPAIRED,
        ),
    }


CASES: dict[str, Hostile] = (
    wrong_arrays()
    | odd_attributes()
    | transforms()
    | lights()
    | old_lights()
    | arcs()
    | networks()
    | metadata()
    | sizes()
)
