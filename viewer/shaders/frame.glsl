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
    // Of air and sun at the eye's place (viewer/air.py):
    vec4 ground_light;  // light on the ground; sine of the sun's height
    vec4 thin_air[3];   // light of the sky, factors of powers of `near`; sun by camera axes
    vec4 thick_air[3];  // the same at the horizon; density of air, of mist; eye's radius
    vec4 upright;       // zenith by camera axes
};

const float EARTH = 6378137.0;
const vec3 TO_UNIT = vec3(1.0, 1.0, 1.0033640898) / EARTH;

vec4 to_clip(vec3 seen) {
    // Reversed depth: near / distance, 0 at infinity.
    return vec4(dot(right.xyz, seen) * right.w, dot(above.xyz, seen) * above.w,
                backward.w, -dot(backward.xyz, seen));
}
