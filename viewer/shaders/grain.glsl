// Grain of the ground finer than a texture's texels, so that near ground is no mush.
// It is anchored to the world: coordinates count patches of 76 m from a multiple of 1024,
// seen from above (HIGH) of 65536.
// The noise is laid out at two sizes, four times apart and faded into each other, chosen
// by what a pixel covers along its longer side: so it neither repeats nor flickers.
layout(binding = 1) uniform sampler2D noise;

vec2 ground_noise(vec2 patches, float pixel) {
    // Two channels, -0.5 to 0.5; a pixel covers so many patches.
#ifdef HIGH
    const float COARSEST = 6.99;
#else
    const float COARSEST = 3.99;
#endif
    float level = clamp(0.5 * log2(512.0 * pixel), -2.0, COARSEST);
    float whole = floor(level);
    // Powers of 4, exact: the noise fits where the count of patches starts again.
    vec2 fine = patches * uintBitsToFloat(uint(127 - 2 * int(whole)) << 23);
    return mix(textureLod(noise, fine, 0.0).rg, textureLod(noise, 0.25 * fine, 0.0).rg,
               level - whole) - 0.5;
}
