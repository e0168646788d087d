out vec3 seen;
out vec2 place;
out float sea;
flat out vec4 draw;

void main() {
    seen = seen_from_eye() + hem();
    place = vec2(detail) / 32768.0;
    sea = float(flags >> 1 & 1);
    draw = draw_place;
    gl_Position = to_clip(seen);
}
