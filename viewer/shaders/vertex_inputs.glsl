// One vertex of 16 bytes, and the record of its draw (viewer/draw_record.py).
layout(location = 0) in ivec3 step_position;
layout(location = 1) in int flags;
layout(location = 2) in uvec2 detail;
layout(location = 3) in vec4 normal;
layout(location = 4) in vec4 draw_origin;  // rest of centre - eye, m; metres per step
layout(location = 5) in vec4 draw_up;      // up; skirt depth, m
layout(location = 6) in vec4 draw_place;   // grain; layer | seed, share of the pattern, coat
layout(location = 7) in vec4 draw_entry;   // entry in the list; screen error, px; lean; texels
layout(location = 8) in vec4 draw_steps;   // whole steps of centre - eye

vec3 seen_from_eye() {
    // The first sum is exact, and small near the eye.
    return (draw_steps.xyz + vec3(step_position)) * draw_origin.w + draw_origin.xyz;
}

vec3 hem() {
    // A skirt hangs down and leans outwards, across its edge: along a parallel, edges with
    // other vertices differ sideways too, and rounding moves all edges; those gaps are
    // seen from straight above.
    float depth = draw_up.w * float(flags & 1);
    vec3 east = normalize(vec3(-draw_up.y, draw_up.x, 0.0));
    vec2 side = vec2(equal(detail, uvec2(32768u))) - vec2(equal(detail, uvec2(0u)));
    vec3 away = side.x * east + side.y * cross(draw_up.xyz, east);
    return depth * (draw_entry.z * away - draw_up.xyz);
}
