const int RING = 194;  // vertices: 96 quads in a strip
const float TURN = 6.2831853 / 96.0;

void main() {
#ifdef HIGH
    // From space only a ring around the globe is lit, and the sun: the rest stays cleared.
    // The ring goes from the ground's rim to the top of the air, or to the zenith.
    vec3 way = normalize(eye.xyz);
    if (gl_VertexID < RING) {
        float radius = length(eye.xyz), angle = float(gl_VertexID / 2) * TURN;
        bool is_top = (gl_VertexID & 1) > 0;
        float part = min((is_top ? 1.016 : 0.997) / radius, 1.0);
        float down = is_top && part == 1.0 ? -1.0 : sqrt(1.0 - part * part);
        vec3 east = normalize(vec3(-way.y, way.x, 1e-9));
        vec3 round_ = cos(angle) * east + sin(angle) * cross(way, east);
        way = (sqrt(1.0 - down * down) * round_ - down * way) / TO_UNIT;
    } else {
        vec3 side = normalize(vec3(-sun.y, sun.x, 1e-9));
        int corner = gl_VertexID - RING;
        way = sun.xyz + 0.006 * (float((corner & 1) * 2 - 1) * side
            + float((corner & 2) - 1) * cross(sun.xyz, side));
    }
    gl_Position = to_clip(way);
    gl_Position.z = 0.0;
#else
    // One triangle over the whole picture, infinitely far away.
    vec2 corner = vec2(gl_VertexID == 1 ? 3.0 : -1.0, gl_VertexID == 2 ? 3.0 : -1.0);
    gl_Position = vec4(corner, 0.0, 1.0);
#endif
}
