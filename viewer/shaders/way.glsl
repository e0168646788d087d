vec3 way_of_pixel() {
    // Unit vector from the eye through the middle of this pixel, ECEF axes.
    vec2 p = (2.0 * gl_FragCoord.xy / picture.xy - 1.0) / vec2(right.w, above.w);
    return normalize(right.xyz * p.x + above.xyz * p.y - backward.xyz);
}
