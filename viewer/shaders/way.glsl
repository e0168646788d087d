vec2 slope_of_pixel() {
    return (2.0 * gl_FragCoord.xy / picture.xy - 1.0) / vec2(right.w, above.w);
}

float along_slope(vec2 slope, vec3 by_axes) {
    // Dot product of a vector by camera axes and the way through a pixel, not shortened.
    return slope.x * by_axes.x + slope.y * by_axes.y - by_axes.z;
}

vec3 way_of_pixel() {
    // Unit vector from the eye through the middle of this pixel, ECEF axes.
    vec2 p = slope_of_pixel();
    return normalize(right.xyz * p.x + above.xyz * p.y - backward.xyz);
}
