layout(binding = 0) uniform sampler2DArray surface;

in vec3 seen;
in vec2 place;
in float sea;
flat in vec4 draw;

layout(location = 0) out vec4 screen;

void main() {
    float distance_ = length(seen);
    vec3 q = eye.xyz + seen * TO_UNIT;
    float inverse = inversesqrt(dot(q, q));
    vec3 up = q * inverse;
    float height = max(1.0 / inverse - 1.0, 0.0);
    vec3 albedo = texture(surface, vec3(place, draw.w)).rgb;
    albedo *= albedo;
    float footprint_m = 2.0 * distance_ / (picture.x * right.w);
    float grains = ground_grain(draw.xy + place * draw.z, draw.z / 256.0, footprint_m);
    grains *= 0.35 * picture.z;
    float water = smoothstep(0.4, 0.9, sea) * smoothstep(0.0, 0.04, albedo.b - albedo.r);
    albedo *= 1.0 + grains * (1.0 - 0.7 * water);
    float light = daylight(up) * picture.w;
    vec3 colour = albedo * light;
    if (water > 0.0) {
        vec3 way = seen / distance_;
        float mu = max(-dot(up, way), 0.0);
        float grazing = 1.0 - mu;
        float fresnel = 0.02 + 0.6 * grazing * grazing * grazing * grazing;
        vec3 mirror = reflect(way, normalize(up + 0.1 * grains * zenith.xyz.yzx));
        float glint = max(dot(mirror, sun.xyz), 0.0);
        glint *= glint; glint *= glint; glint *= glint; glint *= glint; glint *= glint;
        vec3 sky = AIR_LIGHT * vec3(0.35, 0.5, 0.7) * light;
        colour = mix(colour, sky, fresnel * water);
        colour += vec3(1.0, 0.93, 0.8) * (0.14 * glint * glint * water * picture.w);
    }
    screen = to_screen(hazy(colour, seen, up, height));
}
