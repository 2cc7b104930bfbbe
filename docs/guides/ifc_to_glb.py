#!/usr/bin/env python3
"""Converts an IFC building to a GLB file and a file of rooms that Sightline compiles.

Needs IfcOpenShell and NumPy: python3 -m pip install ifcopenshell numpy
"""

import argparse
import json
import struct
import sys
from pathlib import Path

import ifcopenshell
import ifcopenshell.geom
import ifcopenshell.util.element
import numpy

# Elements that are no part of what one sees.
HIDDEN = {"IfcSpace", "IfcOpeningElement", "IfcGrid", "IfcAnnotation", "IfcVirtualElement"}
# What furnishes a building hides nobody reliably.
DETAIL = ("IfcFurnishingElement", "IfcFurniture", "IfcRailing", "IfcFlowTerminal", "IfcMember")
# Words in the names of materials that let light through.
GLASS = ("glass", "glas", "glazing", "verglasung", "vidrio", "verre", "vetro", "transparent")
# How far an opening may be from the edge of a space that it belongs to, in metres.
NEAR_M = 0.6


def main():
    arguments = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    arguments.add_argument("input", type=Path, help="the IFC file")
    arguments.add_argument("-o", "--output", type=Path, required=True, help="the GLB file to write")
    arguments.add_argument(
        "--windows",
        action="store_true",
        help="give rooms windows at all openings in walls; wrong where rooms are open otherwise",
    )
    options = arguments.parse_args()
    try:
        model = ifcopenshell.open(str(options.input))
    except (OSError, RuntimeError, ifcopenshell.Error) as error:
        sys.exit(f"error: cannot read {options.input}: {error}")
    building, spaces, openings = read(model)
    if not building.nodes:
        sys.exit(f"error: {options.input} has no element with a shape")
    options.output.write_bytes(building.glb())
    rooms = options.output.with_suffix(".rooms.toml")
    named = [space for space in spaces if space.outline is not None]
    if named:
        rooms.write_text(rooms_text(named, openings if options.windows else []))
    print(f"{options.output}: {len(building.nodes)} elements")
    if named:
        print(f"{rooms}: {len(named)} of {len(spaces)} spaces")
    doors = " --open-doors 'IfcDoor*'" if building.has_doors else ""
    print(f"next: sightline-server serve {options.output}{doors}")


def read(model):
    """The shapes of all elements, the spaces, and the boxes of openings, in metres with y up."""
    settings = ifcopenshell.geom.settings()
    settings.set("use-world-coords", True)
    building, spaces, openings = Building(), [], []
    iterator = ifcopenshell.geom.iterator(settings, model, include=shown(model))
    if not iterator.initialize():
        return building, spaces, openings
    while True:
        shape = iterator.get()
        element = model.by_id(shape.id)
        points = numpy.array(shape.geometry.verts, dtype=numpy.float64).reshape(-1, 3)
        # IFC has z up.
        points = points[:, [0, 2, 1]] * [1.0, 1.0, -1.0]
        triangles = numpy.array(shape.geometry.faces, dtype=numpy.int64).reshape(-1, 3)
        if element.is_a("IfcSpace"):
            spaces.append(Space(element, points, triangles))
        elif element.is_a("IfcOpeningElement"):
            openings.append((element.Name or "opening", points.min(axis=0), points.max(axis=0)))
        elif len(triangles):
            building.add(element, points, triangles, shape.geometry)
        if not iterator.next():
            return building, spaces, openings


def shown(model):
    """The elements whose shapes are needed."""
    elements = [element for element in model.by_type("IfcElement") if element.is_a() not in HIDDEN]
    return [*elements, *model.by_type("IfcSpace"), *model.by_type("IfcOpeningElement")]


class Building:
    """A GLB file under construction."""

    def __init__(self):
        self.nodes, self.meshes, self.materials = [], [], []
        self.accessors, self.views, self.data = [], [], bytearray()
        self.known, self.storeys, self.has_doors = {}, {}, False

    def add(self, element, points, triangles, geometry):
        styles = list(geometry.materials)
        of_triangle = numpy.array(geometry.material_ids, dtype=numpy.int64)
        if len(of_triangle) != len(triangles):
            of_triangle = numpy.full(len(triangles), -1)
        is_window = element.is_a("IfcWindow")
        lets_through = [self.lets_through(style) for style in styles]
        primitives = []
        for style in numpy.unique(of_triangle):
            corners = points[triangles[of_triangle == style]].reshape(-1, 3)
            material = self.material(styles[style] if style >= 0 else None)
            primitives.append(
                {"attributes": {"POSITION": self.positions(corners)}, "material": material}
            )
        name = f"{element.is_a()} {element.Name or element.GlobalId}"
        self.has_doors |= element.is_a("IfcDoor")
        # A window without glass in its styles would hide whoever is behind it.
        if element.is_a() in DETAIL or is_window and not any(lets_through):
            name += "-noocc"
        self.meshes.append({"primitives": primitives})
        self.nodes.append({"name": name, "mesh": len(self.meshes) - 1})
        storey = ifcopenshell.util.element.get_container(element)
        storey = (storey.Name or storey.GlobalId) if storey else "elsewhere"
        self.storeys.setdefault(storey, []).append(len(self.nodes) - 1)

    @staticmethod
    def lets_through(style):
        transparency = style.transparency
        is_clear = transparency == transparency and transparency > 0.05
        return is_clear or any(word in (style.name or "").lower() for word in GLASS)

    def material(self, style):
        name = "plain" if style is None else style.name or "unnamed"
        rgb = (0.8, 0.8, 0.8) if style is None else style.diffuse.components
        rgb = tuple(linear(part) for part in rgb)
        is_clear = style is not None and self.lets_through(style)
        key = (name, rgb, is_clear)
        if key not in self.known:
            material = {
                "name": name,
                "doubleSided": True,
                "pbrMetallicRoughness": {
                    "baseColorFactor": [*rgb, 0.3 if is_clear else 1.0],
                    "metallicFactor": 0.0,
                },
            }
            if is_clear:
                material["alphaMode"] = "BLEND"
            self.known[key] = len(self.materials)
            self.materials.append(material)
        return self.known[key]

    def positions(self, corners):
        corners = corners.astype("<f4")
        self.views.append({"buffer": 0, "byteOffset": len(self.data), "byteLength": corners.nbytes})
        self.data += corners.tobytes()
        self.accessors.append(
            {
                "bufferView": len(self.views) - 1,
                "componentType": 5126,
                "count": len(corners),
                "type": "VEC3",
                "min": corners.min(axis=0).tolist(),
                "max": corners.max(axis=0).tolist(),
            }
        )
        return len(self.accessors) - 1

    def glb(self):
        elements = len(self.nodes)
        storeys = [{"name": name, "children": nodes} for name, nodes in self.storeys.items()]
        root = {
            "asset": {"version": "2.0", "generator": "ifc_to_glb.py"},
            "scene": 0,
            "scenes": [{"nodes": list(range(elements, elements + len(storeys)))}],
            "nodes": self.nodes + storeys,
            "meshes": self.meshes,
            "materials": self.materials,
            "accessors": self.accessors,
            "bufferViews": self.views,
            "buffers": [{"byteLength": len(self.data)}],
        }
        text = json.dumps(root).encode()
        text += b" " * (-len(text) % 4)
        data = bytes(self.data) + b"\0" * (-len(self.data) % 4)
        chunks = struct.pack("<I4s", len(text), b"JSON") + text
        chunks += struct.pack("<I4s", len(data), b"BIN\0") + data
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


class Space:
    """A space of the building: its name, its outline in the plan, and its heights."""

    def __init__(self, element, points, triangles):
        self.name = element.Name or element.GlobalId
        self.id = element.GlobalId
        self.title = element.LongName or self.name
        self.heights = (points[:, 1].min(), points[:, 1].max())
        self.outline = outline(points, triangles, self.heights[0])


def outline(points, triangles, floor):
    """The corners of the floor of a space as (x, z); `None` where it is no single polygon."""
    # The same corner may be several points.
    corners = [tuple(round(float(part), 3) for part in point) for point in points]
    edges = {}
    for triangle in triangles:
        around = [corners[index] for index in triangle]
        if any(abs(corner[1] - floor) > 0.01 for corner in around):
            continue
        for one, other in zip(around, around[1:] + around[:1]):
            # An edge inside of the floor is there both ways.
            if edges.pop((other, one), None) is None:
                edges[(one, other)] = True
    following = {}
    for one, other in edges:
        if one in following:
            return None
        following[one] = other
    if len(following) < 3:
        return None
    first = next(iter(following))
    found, at = [], first
    while True:
        found.append((at[0], at[2]))
        at = following.get(at)
        if at == first:
            break
        if at is None or len(found) > len(following):
            return None
    return found if len(found) == len(following) else None


def rooms_text(spaces, openings):
    """The rooms of the spaces as TOML, with windows at these openings."""
    lines = ["# Made from the spaces of an IFC file. Edit it as you like.", ""]
    taken = {}
    for space in spaces:
        count = taken[space.name] = taken.get(space.name, 0) + 1
        name = space.name if count == 1 else f"{space.name} {count}"
        lines += [
            "[[room]]",
            f"name = {quoted(name)}",
            f"title = {quoted(space.title)}",
            "polygon = [" + ", ".join(f"[{x:.3f}, {z:.3f}]" for x, z in space.outline) + "]",
            f"heights = [{space.heights[0]:.3f}, {space.heights[1]:.3f}]",
            "",
        ]
        number = 0
        for what, low, high in openings:
            for polygon in panes(space, low, high):
                number += 1
                corners = ", ".join("[" + ", ".join(f"{c:.3f}" for c in at) + "]" for at in polygon)
                lines += [
                    "[[room.window]]",
                    f"name = {quoted(f'{what} {number}')}",
                    f"polygon = [{corners}]",
                    "",
                ]
    return "\n".join(lines)


def panes(space, low, high):
    """What of an opening, a box, lies in the walls of a space: rectangles on its outline."""
    bottom, top = max(low[1], space.heights[0]), min(high[1], space.heights[1])
    if top - bottom < 0.05:
        return
    for (x0, z0), (x1, z1) in zip(space.outline, space.outline[1:] + space.outline[:1]):
        start = numpy.array([x0, z0])
        along = numpy.array([x1, z1]) - start
        length = float(numpy.linalg.norm(along))
        if length < 0.05:
            continue
        along /= length
        across = numpy.array([-along[1], along[0]])
        corners = numpy.array([[x, z] for x in (low[0], high[0]) for z in (low[2], high[2])])
        ways, gaps = (corners - start) @ along, (corners - start) @ across
        # The opening goes through the wall that is on this edge.
        is_here = gaps.min() < NEAR_M and gaps.max() > -NEAR_M and numpy.ptp(gaps) < 2 * NEAR_M
        begin, end = max(ways.min(), 0.0), min(ways.max(), length)
        if is_here and end - begin > 0.05:
            ends = [start + along * begin, start + along * end]
            yield [
                (ends[0][0], bottom, ends[0][1]),
                (ends[1][0], bottom, ends[1][1]),
                (ends[1][0], top, ends[1][1]),
                (ends[0][0], top, ends[0][1]),
            ]


def linear(part):
    """A part of an sRGB colour as linear light."""
    return part / 12.92 if part <= 0.04045 else ((part + 0.055) / 1.055) ** 2.4


def quoted(text):
    return json.dumps(str(text), ensure_ascii=False)


if __name__ == "__main__":
    main()
