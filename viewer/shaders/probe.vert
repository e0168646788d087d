out vec3 seen;
flat out int code;

void main() {
    seen = seen_from_eye();
#ifdef TERRAIN
    seen += hem();
    code = 1 + int(draw_entry.x);
#else
    code = -1 - (int(draw_entry.x) * 65536 + int(detail.y));
#endif
    gl_Position = to_clip(seen);
}
