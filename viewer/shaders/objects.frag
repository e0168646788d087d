in vec2 wall;
flat in vec4 paint;
flat in vec3 pane;
flat in vec3 air;
#ifdef FADE
flat in vec2 share;
#endif

layout(location = 0) out vec4 screen;

vec2 stripes(vec2 x, vec2 width) {
    // Share of a pixel that lies on stripes of half the period: exact at every size.
    vec2 a = x - 0.5 * width, b = x + 0.5 * width;
    vec2 from = 0.5 * floor(a) + clamp(fract(a) - 0.25, 0.0, 0.5);
    vec2 to = 0.5 * floor(b) + clamp(fract(b) - 0.25, 0.0, 0.5);
    return (to - from) / width;
}

void main() {
    vec2 panes = stripes(wall, max(fwidth(wall), vec2(0.02)));
#ifdef FADE
    if (is_left_out(share)) discard;
#endif
    vec3 colour = mix(paint.rgb, pane, 0.8 * paint.a * panes.x * panes.y);
    // Walls are darker towards the street.
    colour *= 1.0 - paint.a * 0.35 * clamp(1.0 - wall.y, 0.0, 1.0);
    screen = to_screen(colour + air);
}
