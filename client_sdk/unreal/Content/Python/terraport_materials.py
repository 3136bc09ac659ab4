"""Create the plugin's materials in the project, once, in the editor: four unlit, four lit.

init_unreal.py calls it when the editor starts. By hand, in the Output Log's Python prompt:
import terraport_materials; terraport_materials.make()

Assets are binary and belong to one engine version, so the plugin ships a script that creates them.
It needs the Python Editor Script Plugin, which is part of the engine and which this plugin enables.
docs/how-to/unreal.md shows the graphs of the materials.
"""

# ruff: noqa: INP001 - Unreal puts this folder on Python's path

from __future__ import annotations

import unreal

__all__ = ["make", "materials"]

FOLDER = "/Game/Terraport"
TEXTURE_PARAMETER = "TerraportTexture"
PUSH_PARAMETER = "TerraportPushBackCm"
DEFAULT_TEXTURE = "/Engine/EngineResources/DefaultTexture.DefaultTexture"

# Vertex colours are bytes of sRGB; the Vertex Color node hands them on as they are (IEC 61966-2-1).
SRGB_TO_LINEAR = "return lerp(C / 12.92, pow((C + 0.055) / 1.055, 2.4), step(0.04045, C));"


def make(folder: str = FOLDER) -> list[str]:
    """Make what is not there yet; returns the paths of all eight.

    Scene actors find them in `FOLDER` by their names; in another folder they are chosen by hand.
    Unlit: a survey's colours have their light in them, and nothing is cheaper on a headset. Lit:
    the project's lights, and shadows, by the normals of the ground.
    """
    paths, made = [], 0
    for name, is_lit, is_base, is_textured in materials():
        path = f"{folder}/{name}"
        if not unreal.EditorAssetLibrary.does_asset_exist(path):
            _make_one(name, folder, is_lit=is_lit, is_base=is_base, is_textured=is_textured)
            made += 1
        paths.append(path)
    if made:
        unreal.log(f"terraport: made {made} materials in {folder}; tick Lit on a scene for lit")
    return paths


def materials() -> list[tuple[str, bool, bool, bool]]:
    """Return name, lit, of the base, textured of each."""
    kinds = []
    for lit in (False, True):
        for base in (False, True):
            for textured in (False, True):
                words = (("Lit", lit), ("Base", base), ("Texture" if textured else "Colour", True))
                name = "".join(word for word, holds in words if holds)
                kinds.append((f"M_Terraport{name}", lit, base, textured))
    return kinds


def _make_one(name: str, folder: str, *, is_lit: bool, is_base: bool, is_textured: bool) -> None:
    tools = unreal.AssetToolsHelpers.get_asset_tools()
    material = tools.create_asset(name, folder, unreal.Material, unreal.MaterialFactoryNew())
    if material is None:
        raise RuntimeError(f"{folder}/{name} could not be created; is the folder writable?")
    model = unreal.MaterialShadingModel
    material.set_editor_property(
        "shading_model", model.MSM_DEFAULT_LIT if is_lit else model.MSM_UNLIT
    )
    # A survey is an open sheet: culled back faces would make its rims vanish.
    material.set_editor_property("two_sided", True)
    colour = _texture(material) if is_textured else _vertex_colour(material)
    output = "RGB" if is_textured else ""
    if is_lit:
        _connect(colour, output, unreal.MaterialProperty.MP_BASE_COLOR)
        # Earth and rock: matt, and nothing mirrored.
        _connect(_number(material, 1.0, 700), "", unreal.MaterialProperty.MP_ROUGHNESS)
        _connect(_number(material, 0.0, 800), "", unreal.MaterialProperty.MP_SPECULAR)
    else:
        _connect(colour, output, unreal.MaterialProperty.MP_EMISSIVE_COLOR)
    if is_base:
        _connect(_push(material), "", unreal.MaterialProperty.MP_WORLD_POSITION_OFFSET)
    unreal.MaterialEditingLibrary.recompile_material(material)
    unreal.EditorAssetLibrary.save_loaded_asset(material)


def _vertex_colour(material: unreal.Material) -> unreal.MaterialExpression:
    """Vertex Color -> sRGB to linear."""
    source = _node(material, unreal.MaterialExpressionVertexColor, -700, 0)
    entry = unreal.CustomInput()
    entry.set_editor_property("input_name", "C")
    decode = _node(material, unreal.MaterialExpressionCustom, -400, 0)
    decode.set_editor_property("description", "sRGB to linear")
    decode.set_editor_property("code", SRGB_TO_LINEAR)
    decode.set_editor_property("output_type", unreal.CustomMaterialOutputType.CMOT_FLOAT3)
    decode.set_editor_property("inputs", [entry])
    # The first output of Vertex Color is its RGB, without alpha.
    _join(source, "", decode, "C")
    return decode


def _number(material: unreal.Material, value: float, y: int) -> unreal.MaterialExpression:
    constant = _node(material, unreal.MaterialExpressionConstant, -300, y)
    constant.set_editor_property("r", value)
    return constant


def _texture(material: unreal.Material) -> unreal.MaterialExpression:
    sample = _node(material, unreal.MaterialExpressionTextureSampleParameter2D, -500, 0)
    sample.set_editor_property("parameter_name", TEXTURE_PARAMETER)
    sample.set_editor_property("texture", unreal.load_asset(DEFAULT_TEXTURE))
    return sample


def _push(material: unreal.Material) -> unreal.MaterialExpression:
    """(place - eye) / |place - eye| * push: along the line of sight, a point stays on its pixel."""
    place = _node(material, unreal.MaterialExpressionWorldPosition, -1000, 400)
    place.set_editor_property(
        "world_position_shader_offset",
        unreal.WorldPositionIncludedOffsets.WPT_EXCLUDE_ALL_SHADER_OFFSETS,
    )
    eye = _node(material, unreal.MaterialExpressionCameraPositionWS, -1000, 550)
    away = _node(material, unreal.MaterialExpressionSubtract, -750, 450)
    _join(place, "", away, "A")
    _join(eye, "", away, "B")
    unit = _node(material, unreal.MaterialExpressionNormalize, -550, 450)
    _join(away, "", unit, "")
    push_cm = _node(material, unreal.MaterialExpressionScalarParameter, -550, 600)
    push_cm.set_editor_property("parameter_name", PUSH_PARAMETER)
    push_cm.set_editor_property("default_value", 0.0)
    push = _node(material, unreal.MaterialExpressionMultiply, -300, 500)
    _join(unit, "", push, "A")
    _join(push_cm, "", push, "B")
    return push


def _node(material: unreal.Material, kind: type, x: int, y: int) -> unreal.MaterialExpression:
    return unreal.MaterialEditingLibrary.create_material_expression(material, kind, x, y)


def _join(
    source: unreal.MaterialExpression, output: str, target: unreal.MaterialExpression, entry: str
) -> None:
    if not unreal.MaterialEditingLibrary.connect_material_expressions(
        source, output, target, entry
    ):
        raise RuntimeError(f"{source} ({output!r}) could not be joined to {target} ({entry!r})")


def _connect(
    source: unreal.MaterialExpression, output: str, target: unreal.MaterialProperty
) -> None:
    if not unreal.MaterialEditingLibrary.connect_material_property(source, output, target):
        raise RuntimeError(f"{source} ({output!r}) could not be joined to {target}")


if __name__ == "__main__":
    make()
