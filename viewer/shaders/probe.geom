// Hands each fragment its whole triangle: interpolated positions of slivers at the rim
// of the globe can be tens of kilometres off, a ray met with the triangle is not.
layout(triangles) in;
layout(triangle_strip, max_vertices = 3) out;

in vec3 seen[];
flat in int code[];
flat in vec2 share[];
flat out vec3 corner_a;
flat out vec3 corner_b;
flat out vec3 corner_c;
flat out int id_code;
flat out vec2 id_share;

void main() {
    for (int i = 0; i < 3; ++i) {
        corner_a = seen[0];
        corner_b = seen[1];
        corner_c = seen[2];
        id_code = code[0];
        id_share = share[0];
        gl_Position = gl_in[i].gl_Position;
        EmitVertex();
    }
    EndPrimitive();
}
