"""Writes an IFC file of two rooms with a door between them and a window to the outside.

The rooms are 4 m by 3 m, side by side along x, in a building whose lengths are in millimetres.
"""

import sys

import ifcopenshell
import ifcopenshell.api
import numpy


def run(usecase, model, **what):
    return ifcopenshell.api.run(usecase, model, **what)


def box(model, body, element, low, high):
    """Gives an element the shape of a box between two corners in metres."""
    (x0, y0, z0), (x1, y1, z1) = low, high
    corners = [(x, y, z) for z in (z0, z1) for y in (y0, y1) for x in (x0, x1)]
    faces = [(0, 2, 3, 1), (4, 5, 7, 6), (0, 1, 5, 4), (2, 6, 7, 3), (0, 4, 6, 2), (1, 3, 7, 5)]
    shape = run(
        "geometry.add_mesh_representation", model, context=body, vertices=[corners], faces=[faces]
    )
    run("geometry.assign_representation", model, product=element, representation=shape)
    run("geometry.edit_object_placement", model, product=element, matrix=numpy.eye(4))
    return shape


def main(path):
    model = ifcopenshell.api.run("project.create_file")
    run("root.create_entity", model, ifc_class="IfcProject", name="Test")
    run("unit.assign_unit", model, length={"is_metric": True, "raw": "MILLIMETERS"})
    whole = run("context.add_context", model, context_type="Model")
    body = run(
        "context.add_context",
        model,
        context_type="Model",
        context_identifier="Body",
        target_view="MODEL_VIEW",
        parent=whole,
    )
    storey = run("root.create_entity", model, ifc_class="IfcBuildingStorey", name="Ground")
    project = model.by_type("IfcProject")[0]
    run("aggregate.assign_object", model, products=[storey], relating_object=project)

    def element(kind, name, low, high):
        made = run("root.create_entity", model, ifc_class=kind, name=name)
        shape = box(model, body, made, low, high)
        run("spatial.assign_container", model, products=[made], relating_structure=storey)
        return made, shape

    # The shell: two slabs and the walls around both rooms, with a hole for the window.
    element("IfcSlab", "floor", (-0.3, -0.3, -0.3), (8.5, 3.3, 0.0))
    element("IfcSlab", "ceiling", (-0.3, -0.3, 2.5), (8.5, 3.3, 2.8))
    element("IfcWall", "south", (-0.3, -0.3, 0.0), (8.5, 0.0, 2.5))
    element("IfcWall", "north", (-0.3, 3.0, 0.0), (8.5, 3.3, 2.5))
    element("IfcWall", "west", (-0.3, 0.0, 0.0), (0.0, 3.0, 2.5))
    element("IfcWall", "east low", (8.2, 0.0, 0.0), (8.5, 3.0, 1.0))
    element("IfcWall", "east high", (8.2, 0.0, 2.0), (8.5, 3.0, 2.5))
    # The wall between, with a doorway from 1 m to 2 m.
    wall, _ = element("IfcWall", "middle a", (4.0, 0.0, 0.0), (4.2, 1.0, 2.5))
    element("IfcWall", "middle b", (4.0, 2.0, 0.0), (4.2, 3.0, 2.5))
    element("IfcWall", "middle c", (4.0, 1.0, 2.1), (4.2, 2.0, 2.5))
    element("IfcDoor", "door", (4.05, 1.0, 0.0), (4.15, 2.0, 2.1))
    doorway = run("root.create_entity", model, ifc_class="IfcOpeningElement", name="doorway")
    box(model, body, doorway, (3.9, 1.0, 0.0), (4.3, 2.0, 2.1))
    run("feature.add_feature", model, feature=doorway, element=wall)
    _, pane = element("IfcWindow", "pane", (8.3, 0.0, 1.0), (8.4, 3.0, 2.0))
    glass = run("style.add_style", model, name="Glass")
    colour = {"SurfaceColour": {"Name": None, "Red": 0.6, "Green": 0.8, "Blue": 0.9}}
    run(
        "style.add_surface_style",
        model,
        style=glass,
        ifc_class="IfcSurfaceStyleShading",
        attributes={**colour, "Transparency": 0.7},
    )
    run("style.assign_representation_styles", model, shape_representation=pane, styles=[glass])

    for name, title, west, east in (("1", "Küche", 0.0, 4.0), ("2", "Salon", 4.2, 8.2)):
        space = run("root.create_entity", model, ifc_class="IfcSpace", name=name)
        space.LongName = title
        box(model, body, space, (west, 0.0, 0.0), (east, 3.0, 2.5))
        run("aggregate.assign_object", model, products=[space], relating_object=storey)
    model.write(path)


main(sys.argv[1])
