flat in vec4 colour;

layout(location = 0) out vec4 screen;

void main() {
    screen = colour;
}
