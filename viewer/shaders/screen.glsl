// The way to the screen: it takes the root of linear colours, and textures are squared
// when read, so an unlit texture comes out as it went in.

vec4 to_screen(vec3 colour) {
    vec3 root = sqrt(clamp(colour, 0.0, 1.0));
    return vec4(root + (pattern() - 0.5) / 255.0, 1.0);
}
