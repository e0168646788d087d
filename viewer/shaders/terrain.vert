out vec2 place;
flat out vec4 draw;
#ifdef GRAIN
flat out float texels;  // across what the data show
#endif
#ifdef HIGH
out vec3 seen;
#else
out vec2 air;  // scale heights of air, and mist, on a metre of the way
#endif

void main() {
    vec3 from_eye = seen_from_eye() + hem();
    place = vec2(detail) / 32768.0;
    draw = draw_place;
#ifdef GRAIN
    texels = draw_entry.w;
#endif
#ifdef HIGH
    seen = from_eye;
#else
    air = air_per_way(max(length(eye.xyz + from_eye * TO_UNIT) - 1.0, 0.0)) / EARTH;
#endif
    gl_Position = to_clip(from_eye);
}
