// The way to the screen: undoes `linear_of` within 0.1 of a step of 8 bits, so an unlit
// texture comes out as it went in. Less than a step of noise hides the steps.
// What is written is cut off at 1.

vec4 to_screen(vec3 colour) {
    vec3 r = sqrt(colour);
    vec3 srgb = r * (1.17186 + r * (-0.22556 + 0.05370 * r));
    return vec4(srgb + (pattern() - 0.5) / 255.0, 1.0);
}
