// Light is added up in linear colours. A polynomial is within 0.003 of the sRGB curve
// (IEC 61966-2-1) and has no branch.

vec3 linear_of(vec3 srgb) {
    return srgb * srgb * (0.72 + 0.28 * srgb);
}
