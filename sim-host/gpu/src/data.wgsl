// What both passes read. Places are in metres and in two parts, `place + rest`, so that differences of them are exact
// where a single one would be rounded.

struct Camera {
    // Columns, rows.
    size: vec2<u32>,
    // Of half the angles of view, across and up.
    tangents: vec2<f32>,
    // Where in a pixel its ray goes.
    sample: vec2<f32>,
    near_m: f32,
    far_m: f32,
    // Greatest and least inverse depths that are seen [1/m].
    nearest: f32,
    farthest: f32,
    // Elements of `plots` per view.
    stride: u32,
    // Words of `pixels` from the depths to the labels, and from those to the colours.
    section: u32,
}

// Indices of bodies, faces, rounds and surfaces count from the first of their scene.
struct Scene {
    first_body: u32,
    bodies: u32,
    first_face: u32,
    faces: u32,
    first_round: u32,
    rounds: u32,
    first_look: u32,
    has_floor: u32,
    even_floor: u32,
    odd_floor: u32,
    first_triangle: u32,
    triangles: u32,
}

struct Body {
    first_face: u32,
    faces: u32,
    first_corner: u32,
    corners: u32,
    // Index of its round side plus one, or nought.
    round: u32,
}

struct Face {
    normal: vec3<f32>,
    surface: u32,
    // The point of its plane that is nearest to the world's origin.
    place: vec3<f32>,
    rest: vec3<f32>,
}

struct Triangle {
    face: Face,
    // Indices among all corners, counterclockwise as seen from in front of the face.
    corners: vec3<u32>,
}

struct Round {
    centre: vec3<f32>,
    radius: f32,
    rest: vec3<f32>,
    surface: u32,
    // Nought for a sphere.
    axis: vec3<f32>,
    colour: vec3<f32>,
}

struct Look {
    label: u32,
    // Red in the lowest byte, then green, blue and opacity.
    colour: u32,
    // Index of its round side plus one, or nought.
    round: u32,
}

struct View {
    eye: vec3<f32>,
    scene: u32,
    rest: vec3<f32>,
    // Rays are `corner + column · per_column + row · per_row`.
    corner: vec3<f32>,
    per_column: vec3<f32>,
    per_row: vec3<f32>,
    right: vec3<f32>,
    down: vec3<f32>,
    forward: vec3<f32>,
    // Inverse depth of the floor: base, per column, per row; noughts for an eye that is not above it.
    floor: vec3<f32>,
}

@group(0) @binding(0) var<uniform> camera: Camera;
@group(0) @binding(1) var<storage, read> scenes: array<Scene>;
@group(0) @binding(2) var<storage, read> bodies: array<Body>;
@group(0) @binding(3) var<storage, read> rounds: array<Round>;
@group(0) @binding(4) var<storage, read> views: array<View>;
