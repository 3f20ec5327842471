"""The plain shader programs, OpenGL 3.3 core: depth, one colour, coloured vertices. Lit solids are in shading.py."""

DEPTH_FRAGMENT = """
#version 330 core
void main() {}
"""

DEPTH_VERTEX = """
#version 330 core
in vec3 position;
uniform mat4 world;
uniform mat4 seen;
void main() { gl_Position = seen * world * vec4(position, 1.0); }
"""

#: Draws each solid in one plain colour: from it the solid under the mouse is read back.
FLAT_FRAGMENT = """
#version 330 core
uniform vec4 colour;
out vec4 shown;
void main() { shown = colour; }
"""

#: Lines and filled areas of the charts and the grid: a colour for each vertex.
PAINT_VERTEX = """
#version 330 core
in vec3 position;
in vec4 tint;
uniform mat4 seen;
out vec4 painted;
void main() {
    painted = tint;
    gl_Position = seen * vec4(position, 1.0);
}
"""

PAINT_FRAGMENT = """
#version 330 core
in vec4 painted;
out vec4 shown;
void main() { shown = painted; }
"""
