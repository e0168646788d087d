float mirrored(float mu) {
    // Share of the light that water mirrors.
    float grazing = (1.0 - mu) * (1.0 - mu);
    return 0.02 + 0.5 * grazing * grazing;
}

const vec3 MIRRORED_SKY = vec3(0.30, 0.46, 0.68);
