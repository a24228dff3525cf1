"""A commented scene that works: what `--example scene` prints."""

EXAMPLE = """\
# A scene: what is around the arm, in the frame of the robot's base (or with --base in a frame of its own).
# Lengths in m; position is an object's centre; quaternion is x, y, z, w and may be left out.
# MoveIt's PlanningScene messages (YAML, JSON) and .scene files are read as well.
objects:
  - name: table
    type: box                     # box, sphere, cylinder, cone, plane or mesh
    size: [0.8, 1.2, 0.04]        # full edges x, y, z
    position: [0.75, 0.0, 0.1]

  - name: post
    type: cylinder                # a cone alike; its axis is z, its tip above
    radius: 0.04
    height: 0.9
    position: [-0.3, 0.5, 0.45]

  - name: ball
    type: sphere
    radius: 0.1
    position: [0.4, -0.6, 0.5]

  - name: wall
    type: plane                   # solid on the side that the robot's base is not on; its normal is z of its frame
    position: [0.0, -1.0, 0.0]
    quaternion: [-0.70710678, 0.0, 0.0, 0.70710678]

#  - name: fixture
#    type: mesh
#    file: fixture.stl            # STL or OBJ in this file's folder
#    scale: 0.001                 # a drawing in mm
#    position: [0.6, 0.2, 0.12]

#  - name: part                   # held by the tool: moves with it, position in the tool's frame
#    type: box
#    size: [0.06, 0.06, 0.1]
#    position: [0.0, 0.0, 0.15]
#    attach: true                 # or the name of a link
#    touch_links: [panda_hand]    # links that may touch it, beside the one that carries it

# allow:                          # pairs that may touch
#  - [part, table]
"""
