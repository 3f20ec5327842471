"""How solids are lit, OpenGL 3.3 core: sun with soft shadows, sky, finishes of materials, carved height maps.

A finish is computed from positions in the object's frame [m], so that grain, rings and beads have their real size and
move with the object.
"""

VERTEX = """
#version 330 core
in vec3 position;
in vec3 normal;
uniform mat4 world;
uniform mat3 turned;
uniform mat4 seen;
out vec3 place;
out vec3 facing;
out vec3 own;
out vec3 own_facing;
void main() {
    vec4 at = world * vec4(position, 1.0);
    place = at.xyz;
    own = position;
    own_facing = normal;
    facing = turned * normal;
    gl_Position = seen * at;
}
"""

#: Noise without tables: value noise on a lattice, and the distances to the two nearest of scattered points.
_NOISE = """
float scatter(vec3 p) {
    p = fract(p * vec3(0.1031, 0.1030, 0.0973));
    p += dot(p, p.yzx + 33.33);
    return fract((p.x + p.y) * p.z);
}
float noise(vec3 p) {
    vec3 i = floor(p), f = fract(p);
    f = f * f * (3.0 - 2.0 * f);
    vec2 d = vec2(0.0, 1.0);
    return mix(mix(mix(scatter(i), scatter(i + d.yxx), f.x), mix(scatter(i + d.xyx), scatter(i + d.yyx), f.x), f.y),
               mix(mix(scatter(i + d.xxy), scatter(i + d.yxy), f.x), mix(scatter(i + d.xyy), scatter(i + d.yyy), f.x),
                   f.y), f.z);
}
vec2 beads(vec3 p) {
    vec3 i = floor(p), f = fract(p);
    float first = 9.0, second = 9.0;
    for (int x = -1; x <= 1; ++x) for (int y = -1; y <= 1; ++y) for (int z = -1; z <= 1; ++z) {
        vec3 cell = vec3(x, y, z), at = i + cell;
        vec3 centre = cell + 0.15 + 0.7 * vec3(scatter(at), scatter(at + 17.0), scatter(at + 41.0)) - f;
        float far = dot(centre, centre);
        if (far < first) { second = first; first = far; } else if (far < second) second = far;
    }
    return sqrt(vec2(first, second));
}
"""

#: The carved map, projected as in ``itouch.contact.effects``; slopes are shown three times as steep as they are felt.
_RELIEF = """
uniform sampler2D heights;
uniform vec4 carve;  // columns * pitch, rows * pitch, depth [m]; depth 0: no map; axis, -1: along all three
const float STEEPER = 3.0;
float slopes(vec2 uv, out vec2 slope) {
    vec2 size = vec2(textureSize(heights, 0)), span = carve.xy;
    vec2 at = uv / span + 0.5, wide = fwidth(at) * size;
    vec2 e = max(vec2(1.0), wide) / size;
    float right = texture(heights, at + vec2(e.x, 0.0)).r, left = texture(heights, at - vec2(e.x, 0.0)).r;
    float up = texture(heights, at + vec2(0.0, e.y)).r, down = texture(heights, at - vec2(0.0, e.y)).r;
    slope = carve.z * vec2(right - left, up - down) / (2.0 * e * span);
    return texture(heights, at).r;
}
vec3 carved(vec3 q, vec3 n, out float height) {
    vec3 weight = carve.w < 0.0 ? n * n * n * n : vec3(equal(vec3(0.0, 1.0, 2.0), vec3(carve.w)));
    weight /= max(weight.x + weight.y + weight.z, 1e-6);
    vec2 x, y, z;
    height = dot(weight, vec3(slopes(q.yz, x), slopes(q.xz, y), slopes(q.xy, z)));
    vec3 up = weight.x * vec3(0.0, x) + weight.y * vec3(y.x, 0.0, y.y) + weight.z * vec3(z, 0.0);
    return normalize(n - STEEPER * (up - n * dot(up, n)));
}
"""

_LIGHT = """
float light(vec3 n) {
    float lean = dot(n, sun);  // a surface is looked at from outside of itself, the further the more it leans
    float off = texel * (1.5 + 2.6 * min(sqrt(max(1.0 - lean * lean, 0.0)) / max(lean, 0.05), 4.0));
    vec4 shade = lit * vec4(place + off * n, 1.0);
    vec3 at = shade.xyz / shade.w * 0.5 + 0.5;
    if (at.z > 1.0 || any(lessThan(at.xy, vec2(0.0))) || any(greaterThan(at.xy, vec2(1.0)))) return 1.0;
    vec2 size = vec2(textureSize(shadows, 0)), corner = at.xy * size - 0.5, part = fract(corner);
    ivec2 first = ivec2(floor(corner)) - 2, last = ivec2(size) - 1;
    float sum = 0.0;  // the mean of 5 by 5 samples that slides with the place: no steps in the penumbra
    for (int i = 0; i < 6; ++i)
        for (int j = 0; j < 6; ++j) {
            float across = i == 0 ? 1.0 - part.x : i == 5 ? part.x : 1.0;
            float up = j == 0 ? 1.0 - part.y : j == 5 ? part.y : 1.0;
            float near = texelFetch(shadows, clamp(first + ivec2(i, j), ivec2(0), last), 0).r;
            sum += across * up * step(at.z - 0.0005, near);
        }
    return sum / 25.0;
}
vec3 sky(vec3 way) {
    float up = smoothstep(-0.25, 0.9, way.z);
    vec3 far = mix(vec3(0.27, 0.265, 0.26), vec3(0.66, 0.70, 0.76), up);
    float window = smoothstep(0.18, 0.30, way.y + 0.25 * way.z) * smoothstep(0.86, 0.74, way.z + 0.1 * way.x);
    return far + 0.42 * window * smoothstep(0.05, 0.22, way.z);
}
"""

FRAGMENT = f"""
#version 330 core
in vec3 place;
in vec3 facing;
in vec3 own;
in vec3 own_facing;
uniform vec3 eye;
uniform vec3 sun;
uniform vec4 colour;
uniform float gloss;
uniform float dark;
uniform mat4 lit;
uniform float texel;  // size of a sample of the shadows [m]
uniform float finish;
uniform mat3 turned;
uniform sampler2D shadows;
out vec4 shown;
{_NOISE}
{_RELIEF}
{_LIGHT}
void main() {{
    vec3 to_eye = normalize(eye - place), tint = colour.rgb;
    vec3 n = normalize(facing);
    vec3 flat_n = dot(n, to_eye) < 0.0 ? -n : n;
    float alpha = colour.a, mirror = 0.0, sharp = 40.0, spark = gloss, soft = 0.0;
    float pixel = length(fwidth(own));  // [m]: what is finer is not drawn, it would flicker
    if (carve.z > 0.0) {{
        float height;
        n = normalize(turned * carved(own, normalize(own_facing), height));
        tint *= 0.80 + 0.25 * height;
    }}
    if (dot(n, to_eye) < 0.0) n = -n;
    float edge = pow(1.0 - max(dot(n, to_eye), 0.0), 5.0);
    if (finish == 1.0) {{  // brushed metal: fine lines along x, the sky in it
        float fine = noise(own * vec3(90.0, 5200.0, 5200.0)) - 0.5, wide = noise(own * vec3(25.0, 900.0, 900.0)) - 0.5;
        float seen_lines = clamp(0.00035 / pixel, 0.0, 1.0);
        tint *= 1.0 + 0.13 * fine * seen_lines + 0.09 * wide;
        n = normalize(n + 0.05 * (wide + fine * seen_lines) * vec3(0.0, 1.0, 0.3));
        mirror = 0.62 + 0.38 * edge; sharp = 70.0; spark = 0.9;
    }} else if (finish == 2.0) {{  // glass: clear where one looks straight into it, a mirror along it
        mirror = 0.10 + 0.90 * edge; sharp = 260.0; spark = 1.0;
        alpha *= 0.58 + 0.42 * edge;
    }} else if (finish == 3.0) {{  // wood: rings about an axis below the block, fibres along x
        vec2 wave = vec2(noise(own * vec3(30.0, 130.0, 130.0)), noise(own * vec3(24.0, 90.0, 90.0) + 9.0));
        vec3 bent = own + 0.0016 * vec3(0.0, wave);
        float radius = length(vec2(bent.y + 0.011, bent.z + 0.046) + 0.05 * bent.x * vec2(0.4, 0.25));
        float ring = fract(radius / 0.0042 + 0.35 * noise(own * vec3(12.0, 60.0, 60.0)));
        float late = smoothstep(0.35, 0.92, ring) * smoothstep(1.0, 0.95, ring);
        float fibre = noise(own * vec3(160.0, 3600.0, 3600.0)) - 0.5;
        late = mix(0.35, late, clamp(0.0021 / pixel, 0.0, 1.0));
        tint *= mix(vec3(1.14, 1.12, 1.08), vec3(0.74, 0.66, 0.56), late);
        tint *= 1.0 + 0.16 * fibre * clamp(0.0005 / pixel, 0.0, 1.0);
        spark = 0.10; sharp = 18.0;
    }} else if (finish == 4.0) {{  // foam of beads, 3 mm; light goes a little way into it
        vec2 near = beads(own / 0.0030);
        float seam = smoothstep(0.16, 0.0, near.y - near.x) * clamp(0.0030 / (4.0 * pixel), 0.0, 1.0);
        tint *= (1.0 - 0.20 * seam) * (0.97 + 0.06 * scatter(floor(own / 0.0030)));
        spark = 0.05; sharp = 10.0; soft = 0.35;
    }}
    float above = 0.5 + 0.5 * n.z;
    float direct = max((dot(n, sun) + soft) / (1.0 + soft), 0.0);
    float lamp = direct > 0.0 ? mix(1.0, light(flat_n), dark) : 0.0;
    vec3 ambient = mix(vec3(0.19, 0.19, 0.21), vec3(0.38, 0.40, 0.44), above);
    vec3 body = tint * (ambient + 0.56 * direct * lamp);
    vec3 glance = sky(reflect(-to_eye, n)) * (finish == 1.0 ? tint * 1.12 : vec3(1.0)) * mix(0.62, 1.0, lamp);
    float glint = pow(max(dot(n, normalize(sun + to_eye)), 0.0), sharp) * spark;
    vec3 sum = mix(body, glance, mirror) + 0.7 * glint * lamp;
    shown = vec4(pow(sum, vec3(1.0 / 1.15)), min(1.0, alpha + glint * lamp));
}}
"""
