// First pass, a workgroup a view: how each face, body and cylinder of its scene is drawn. What `Body::plot` does on
// the CPU, in single precision; per view the faces, then the areas of the bodies, then three elements a cylinder.

@group(0) @binding(5) var<storage, read> faces: array<Face>;
@group(0) @binding(6) var<storage, read> corners: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> plots: array<vec4<u32>>;

const LANES = 64u;

// Distance within which an eye counts as being beside a plane and not in it [m].
const LEAST_DISTANCE = 1e-6;

@compute @workgroup_size(LANES)
fn plot(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let view = views[group.x];
    let scene = scenes[view.scene];
    let of_faces = group.x * camera.stride;
    let of_areas = of_faces + scene.faces;
    let of_rounds = of_areas + scene.bodies;
    for (var index = lane; index < scene.faces; index += LANES) {
        plots[of_faces + index] = plotted_face(view, faces[scene.first_face + index]);
    }
    for (var index = lane; index < scene.bodies; index += LANES) {
        plots[of_areas + index] = area(view, bodies[scene.first_body + index]);
    }
    for (var index = lane; index < scene.rounds; index += LANES) {
        let side = plotted_side(view, rounds[scene.first_round + index]);
        plots[of_rounds + 3u * index] = side.middle;
        plots[of_rounds + 3u * index + 1u] = side.spread;
        plots[of_rounds + 3u * index + 2u] = side.more;
    }
}

// From a place to the eye.
fn away(view: View, place: vec3<f32>, rest: vec3<f32>) -> vec3<f32> {
    return (view.eye - place) + (view.rest - rest);
}

fn beside(distance: f32) -> f32 {
    let least = select(-LEAST_DISTANCE, LEAST_DISTANCE, distance >= 0.0);
    return select(distance, least, abs(distance) < LEAST_DISTANCE);
}

// Inverse depth: base, per column, per row; then the surface if the face is entered, else nought.
fn plotted_face(view: View, face: Face) -> vec4<u32> {
    let distance = beside(dot(face.normal, away(view, face.place, face.rest)));
    let shares = vec3(dot(face.normal, view.corner), dot(face.normal, view.per_column), dot(face.normal, view.per_row));
    return vec4(bitcast<vec3<u32>>(-shares / distance), select(0u, face.surface, distance > 0.0));
}

// Columns and rows that a body may cover: first columns and rows, then one past the last; nothing if they are the same.
fn area(view: View, body: Body) -> vec4<u32> {
    let size = vec2<f32>(camera.size);
    var low = size + 3.0;
    var high = vec2(-3.0);
    var before = false;
    var behind = false;
    for (var index = 0u; index < body.corners; index++) {
        let corner = -away(view, corners[body.first_corner + index].xyz, vec3(0.0));
        let depth = dot(corner, view.forward);
        before |= depth > camera.near_m;
        behind |= depth <= camera.near_m;
        let across = vec2(dot(corner, view.right), dot(corner, view.down));
        let share = across / (max(depth, camera.near_m) * camera.tangents);
        let place = 0.5 * (share + 1.0) * size - camera.sample;
        low = min(low, place);
        high = max(high, place);
    }
    if !before {
        return vec4(0u);
    }
    if behind {
        return vec4(vec2(0u), camera.size);
    }
    let first = vec2<u32>(clamp(floor(low) - 1.0, vec2(0.0), size));
    let end = vec2<u32>(clamp(ceil(high) + 2.0, vec2(0.0), size));
    return select(vec4(0u), vec4(first, end), all(first < end));
}

// Where rays meet the side of a cylinder, or a sphere: at the inverse depths `middle ± √spread`.
struct Side {
    // Base, per column, per row; the surface.
    middle: vec4<u32>,
    // Constant, column, row, column².
    spread: vec4<u32>,
    // Column · row, row²; whether the eye is outside.
    more: vec4<u32>,
}

fn plotted_side(view: View, round: Round) -> Side {
    let eye = across(round.axis, away(view, round.centre, round.rest));
    let corner = across(round.axis, view.corner);
    let right = across(round.axis, view.per_column);
    let down = across(round.axis, view.per_row);
    let c = beside((length(eye) - round.radius) * (length(eye) + round.radius));
    let middle = -vec3(dot(eye, corner), dot(eye, right), dot(eye, down)) / c;
    // The discriminant B² − A C is r² v·v − |eye × v|²: squares of distances from the axis, which do not cancel.
    let of_corner = cross(eye, corner) / c;
    let of_right = cross(eye, right) / c;
    let of_down = cross(eye, down) / c;
    let scale = (round.radius / c) * (round.radius / c);
    let squares = vec3(dot(corner, corner), dot(right, right), dot(down, down)) * scale
        - vec3(dot(of_corner, of_corner), dot(of_right, of_right), dot(of_down, of_down));
    let products = 2.0 * (vec3(dot(corner, right), dot(corner, down), dot(right, down)) * scale
        - vec3(dot(of_corner, of_right), dot(of_corner, of_down), dot(of_right, of_down)));
    return Side(
        vec4(bitcast<vec3<u32>>(middle), round.surface),
        bitcast<vec4<u32>>(vec4(squares.x, products.x, products.y, squares.y)),
        vec4(bitcast<vec2<u32>>(vec2(products.z, squares.z)), select(0u, 1u, c > 0.0), 0u),
    );
}

fn across(axis: vec3<f32>, vector: vec3<f32>) -> vec3<f32> {
    return vector - axis * dot(vector, axis);
}
