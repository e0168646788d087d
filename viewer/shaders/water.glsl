// Water mirrors the sky, more at grazing angles (Schlick 1994; less, as waves tilt it),
// and the sun where waves have the slope for it (Cox and Munk 1954, for 3 m/s of wind).

float mirrored(float mu) {
    float grazing = 1.0 - mu;
    grazing *= grazing;
    return 0.02 + 0.5 * grazing * grazing;
}

const vec3 MIRRORED_SKY = vec3(0.30, 0.46, 0.68);
const float SLOPES = 0.02;  // mean square of the slopes
const vec3 GLINT = vec3(11.0, 10.6, 9.8);

vec3 glint(float near, float rise, float mu) {
    // A wave mirrors the sun when it faces halfway between the sun and the eye: a slope
    // with the square |sun + to_eye|^2 / (up . (sun + to_eye))^2 - 1.
    float level = max(rise + mu, 0.05);
    float slope = max(4.0 * (1.0 - near) / (level * level) - 1.0, 0.0);
    // Few waves face the sun wholly, and flash: a core that is a fifth as wide.
    float wide = exp2(-1.442695 / SLOPES * slope), core = wide * wide;
    core *= core; core *= core;
    return GLINT * (0.6 * wide + 3.0 * core * core * core);
}
