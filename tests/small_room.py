"""A small stage as a file, for tests of whole commands: a closed room of six walls with a lamp."""

from pathlib import Path

FLOOR = """    def Mesh "Floor" {
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0)]
        uniform token subdivisionScheme = "none"
    }
"""
WALLS = """    def Mesh "Walls" {
        int[] faceVertexCounts = [4, 4, 4, 4, 4]
        int[] faceVertexIndices = [0, 4, 5, 1, 1, 5, 6, 2, 2, 6, 7, 3, 3, 7, 4, 0, 4, 7, 6, 5]
        point3f[] points = [(-2, -2, 0), (2, -2, 0), (2, 2, 0), (-2, 2, 0),
                            (-2, -2, 3), (2, -2, 3), (2, 2, 3), (-2, 2, 3)]
        color3f[] primvars:displayColor = [(0.6, 0.6, 0.6)]
        uniform token subdivisionScheme = "none"
    }
"""
LAMP = """    def SphereLight "Lamp" {
        float inputs:intensity = 1000
        float inputs:radius = 0.1
        double3 xformOp:translate = (0, 0, 2)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
"""


def write_stage(path: Path, *prims: str, settings: str = "") -> Path:
    """A stage of these prims under /World, in metres and Z-up.

    settings : attributes of a RenderSettings prim with IsoluxSolverAPI; none: no such prim
    """
    metadata = '    metersPerUnit = 1\n    upAxis = "Z"\n'
    body = 'def Xform "World" {\n' + "".join(prims) + "}\n"
    if settings:
        metadata += '    renderSettingsPrimPath = "/Render"\n'
        applied = '( prepend apiSchemas = ["IsoluxSolverAPI"] )'
        body += f'def RenderSettings "Render" {applied} {{\n{settings}\n}}\n'
    path.write_text(f"#usda 1.0\n(\n{metadata})\n{body}", encoding="utf-8")
    return path


def write_room(path: Path, settings: str = "") -> Path:
    """The closed room."""
    return write_stage(path, FLOOR, WALLS, LAMP, settings=settings)
