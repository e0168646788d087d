// A draw of the frame once more, in one colour, a little nearer than it was.
uniform vec4 paint;          // colour and opacity
uniform float threshold_px;  // above 0: the colour tells the draw's error
#ifndef TERRAIN
uniform int only;            // object of the tile, or -1 for all
#endif
flat out vec4 colour;

const vec3 FINE[3] = vec3[3](
    vec3(0.97, 0.97, 0.97), vec3(0.42, 0.68, 0.84), vec3(0.03, 0.19, 0.42));
const vec3 COARSE[3] = vec3[3](
    vec3(0.97, 0.97, 0.97), vec3(0.95, 0.60, 0.27), vec3(0.50, 0.15, 0.02));

vec3 heat(float error_px) {
    // One step of a ramp for each 2.8 times: an eighth, the same, eight times.
    float x = clamp(log2(max(error_px, 1e-6) / threshold_px) / 1.5, -2.0, 2.0);
    int low = min(int(abs(x)), 1);
    float part = abs(x) - float(low);
    return x < 0.0 ? mix(FINE[low], FINE[low + 1], part)
                   : mix(COARSE[low], COARSE[low + 1], part);
}

void main() {
    vec3 seen = seen_from_eye();
#ifdef TERRAIN
    seen += hem();
#endif
    colour = threshold_px > 0.0 ? vec4(heat(draw_entry.y), paint.a) : paint;
    gl_Position = to_clip(seen);
    gl_Position.z *= 1.0005;
#ifndef TERRAIN
    if (only >= 0 && int(detail.y) != only) gl_Position = vec4(0.0, 0.0, 2.0, 1.0);
#endif
}
