in vec3 seen;
in vec2 wall;
flat in vec4 paint;
flat in vec2 glass;

layout(location = 0) out vec4 screen;

vec2 stripes(vec2 x, vec2 width) {
    // Share of a pixel that lies on stripes of half the period: exact at every size.
    vec2 a = x - 0.5 * width, b = x + 0.5 * width;
    vec2 from = 0.5 * floor(a) + clamp(fract(a) - 0.25, 0.0, 0.5);
    vec2 to = 0.5 * floor(b) + clamp(fract(b) - 0.25, 0.0, 0.5);
    return (to - from) / width;
}

void main() {
    vec3 colour = paint.rgb;
    if (paint.a > 0.5) {
        vec2 grid = vec2(wall.x / 2.9, wall.y / glass.y);
        vec2 share = stripes(grid, max(fwidth(grid), vec2(0.02)));
        vec3 pane = vec3(0.10, 0.13, 0.17) * glass.x * picture.w;
        colour = mix(colour, pane, 0.8 * share.x * share.y);
        colour *= 0.62 + 0.38 * clamp(wall.y / 3.0, 0.0, 1.0);
    }
    vec3 q = eye.xyz + seen * TO_UNIT;
    float inverse = inversesqrt(dot(q, q));
    screen = to_screen(hazy(colour, seen, q * inverse, max(1.0 / inverse - 1.0, 0.0)));
}
