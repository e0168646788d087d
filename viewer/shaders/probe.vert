out vec3 seen;
flat out int code;
flat out vec2 share;

void main() {
    seen = seen_from_eye();
#ifdef TERRAIN
    seen += hem();
    code = 1 + int(draw_entry.x);
    share = vec2(0.0, 2.0);
#else
    code = -1 - (int(draw_entry.x) * 65536 + int(detail.y));
    share = draw_place.yz;
#endif
    gl_Position = to_clip(seen);
}
