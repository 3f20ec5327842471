"""The shader programs, OpenGL 3.3 core."""

SOLID_VERTEX = """
#version 330 core
in vec3 position;
in vec3 normal;
uniform mat4 world;
uniform mat3 turned;
uniform mat4 seen;
uniform mat4 lit;
out vec3 place;
out vec3 facing;
out vec4 shade;
void main() {
    vec4 at = world * vec4(position, 1.0);
    place = at.xyz;
    facing = turned * normal;
    shade = lit * at;
    gl_Position = seen * at;
}
"""

SOLID_FRAGMENT = """
#version 330 core
in vec3 place;
in vec3 facing;
in vec4 shade;
uniform vec3 eye;
uniform vec3 sun;
uniform vec4 colour;
uniform float gloss;
uniform float dark;
uniform sampler2D shadows;
out vec4 shown;
float light() {
    vec3 at = shade.xyz / shade.w * 0.5 + 0.5;
    if (at.z > 1.0 || any(lessThan(at.xy, vec2(0.0))) || any(greaterThan(at.xy, vec2(1.0)))) return 1.0;
    vec2 texel = 1.0 / vec2(textureSize(shadows, 0));
    float sum = 0.0;
    for (int i = -1; i <= 1; ++i)
        for (int j = -1; j <= 1; ++j)
            sum += step(at.z - 0.0012, texture(shadows, at.xy + vec2(i, j) * texel).r);
    return sum / 9.0;
}
void main() {
    vec3 n = normalize(facing);
    vec3 to_eye = normalize(eye - place);
    if (dot(n, to_eye) < 0.0) n = -n;
    float above = 0.5 + 0.5 * n.z;
    float direct = max(dot(n, sun), 0.0);
    float lamp = direct > 0.0 ? mix(1.0, light(), dark) : 0.0;
    vec3 ambient = mix(vec3(0.17, 0.17, 0.20), vec3(0.36, 0.38, 0.42), above);
    float spark = pow(max(dot(n, normalize(sun + to_eye)), 0.0), 40.0) * gloss;
    vec3 sum = colour.rgb * (ambient + 0.58 * direct * lamp) + 0.7 * spark * lamp;
    shown = vec4(pow(sum, vec3(1.0 / 1.15)), colour.a);
}
"""

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

#: Draws every solid in one plain colour: what lies under the mouse is read back from it.
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
