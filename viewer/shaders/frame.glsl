// What all shaders know of the frame. Positions are relative to the eye, ECEF axes, m.
#version 430 core

layout(std140, binding = 0) uniform Frame {
    vec4 right;     // xyz camera axis, w = 2 focal / width
    vec4 above;     // xyz camera axis, w = 2 focal / height
    vec4 backward;  // xyz camera axis, w = near plane, m
    vec4 eye;       // xyz in units of the ellipsoid's axes, w = height, m
    vec4 sun;       // xyz direction to the sun, w = light that reaches the night side
    vec4 zenith;    // xyz up at the eye, w = strength of the haze
    vec4 picture;   // width, height, strength of the grain, strength of light
};

const float EARTH = 6378137.0;
const vec3 TO_UNIT = vec3(1.0, 1.0, 1.0033640898) / EARTH;

vec4 to_clip(vec3 seen) {
    // Reversed depth: near / distance, 0 at infinity.
    return vec4(dot(right.xyz, seen) * right.w, dot(above.xyz, seen) * above.w,
                backward.w, -dot(backward.xyz, seen));
}
