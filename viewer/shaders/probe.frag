flat in vec3 corner_a;
flat in vec3 corner_b;
flat in vec3 corner_c;
flat in int id_code;
flat in vec2 id_share;

layout(location = 0) out vec4 place;
layout(location = 1) out int id;

vec3 weights(vec3 way) {
    // Of the three corners where a ray meets the triangle, and never outside it.
    vec3 ab = corner_b - corner_a, ac = corner_c - corner_a;
    vec3 p = cross(way, ac), q = cross(corner_a, ab);
    float determinant = dot(ab, p);
    if (determinant == 0.0) return vec3(1.0 / 3.0);
    vec2 share = vec2(-dot(corner_a, p), -dot(way, q)) / determinant;
    vec3 all_ = max(vec3(1.0 - share.x - share.y, share), 0.0);
    return all_ / (all_.x + all_.y + all_.z);
}

void main() {
    if (is_left_out(id_share)) discard;
    vec3 w = weights(way_of_pixel());
    place = vec4(w.x * corner_a + w.y * corner_b + w.z * corner_c, 1.0);
    id = id_code;
}
