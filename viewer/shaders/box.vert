// Edges of a box whose up is away from the middle of the earth.
layout(location = 0) in vec4 from_eye;  // centre - eye, m
layout(location = 1) in vec4 half_m;    // east, north, up; 1 for a stand-in
layout(location = 2) in vec4 box_up;
flat out vec4 colour;

void main() {
    // An edge runs along one axis; two bits tell where it is along the others.
    int edge = gl_VertexID / 2, axis = edge / 4;
    vec3 corner;
    corner[axis] = float(2 * (gl_VertexID & 1) - 1);
    corner[(axis + 1) % 3] = float(2 * (edge & 1) - 1);
    corner[(axis + 2) % 3] = float((edge & 2) - 1);
    corner *= half_m.xyz;
    vec3 up = normalize(box_up.xyz);
    vec3 east = normalize(vec3(-up.y, up.x, 1e-12));
    vec3 seen = from_eye.xyz + corner.x * east + corner.y * cross(up, east) + corner.z * up;
    colour = half_m.w > 0.5 ? vec4(1.0, 0.6, 0.1, 0.9) : vec4(1.0, 1.0, 1.0, 0.75);
    gl_Position = to_clip(seen);
}
