out vec2 place;
flat out vec4 draw;
#ifdef HIGH
out vec3 seen;
#else
out vec2 air;  // scale heights of air on a metre of the way; daylight
#endif

void main() {
    vec3 from_eye = seen_from_eye() + hem();
    place = vec2(detail) / 32768.0;
    draw = draw_place;
#ifdef HIGH
    seen = from_eye;
#else
    vec3 q = eye.xyz + from_eye * TO_UNIT;
    float radius = length(q);
    air.x = relative_air(max(radius - 1.0, 0.0), eye.w / EARTH, 1.0 / EARTH);
    air.y = daylight(q / radius);
#endif
    gl_Position = to_clip(from_eye);
}
