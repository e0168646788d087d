// Grain of the ground finer than a texture's texels, so that near ground is no mush.
// It is anchored to the world: coordinates count patches of 76 m from a multiple of 256.

float lattice(uvec2 at, uint mask) {
    at &= mask;
    uint x = at.x * 1597334677u ^ at.y * 3812015801u;
    x = (x ^ x >> 15) * 2246822519u;
    return float(x >> 8) * (1.0 / 16777216.0);
}

float waves(vec2 patches, float octave) {
    // Smooth noise, 0 to 1, with exp2(octave) waves on a patch.
    vec2 at = patches * exp2(octave);
    vec2 corner = floor(at);
    vec2 s = at - corner;
    s = s * s * (3.0 - 2.0 * s);
    uvec2 i = uvec2(corner);
    uint mask = uint(exp2(8.0 + octave)) - 1u;
    float south = mix(lattice(i, mask), lattice(i + uvec2(1u, 0u), mask), s.x);
    float north = mix(lattice(i + uvec2(0u, 1u), mask), lattice(i + uvec2(1u), mask), s.x);
    return mix(south, north, s.y);
}

float ground_grain(vec2 patches, float texel, float footprint_m) {
    // Waves of about 9 pixels at every distance: two octaves, faded into each other.
    float waves_wanted = 76.4 / (9.0 * footprint_m);
    float octave = clamp(log2(waves_wanted), -7.0, 9.0);
    float whole = floor(octave), share = octave - whole;
    float seen_texel = 3.0 * texel * waves_wanted;
    float grains = mix(waves(patches, whole), waves(patches, whole + 1.0), share) - 0.5;
    return grains * smoothstep(0.6, 3.0, seen_texel);
}
