// A number from 0 to 1 for each pixel of the screen (Jimenez 2014, interleaved gradient
// noise): any 3 x 3 pixels have nearly all values, evenly.

float pattern() {
    return fract(52.9829189 * fract(dot(gl_FragCoord.xy, vec2(0.06711056, 0.00583715))));
}

bool is_left_out(vec2 share) {
    // What replaces each other has shares that join: a pixel shows exactly one of them.
    float p = pattern();
    return p < share.x || p >= share.y;
}
