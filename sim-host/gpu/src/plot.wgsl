// First pass, a workgroup a view: how each face, body, triangle and cylinder of its scene is drawn. What `Body::plot` and
// `Mesh::plot` do on the CPU, in single precision; per view the faces, then the areas of the bodies, then those of the
// triangles, then three elements a cylinder, then four a triangle.

@group(0) @binding(5) var<storage, read> faces: array<Face>;
@group(0) @binding(6) var<storage, read> corners: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> plots: array<vec4<u32>>;
@group(0) @binding(8) var<storage, read> triangles: array<Triangle>;

const LANES = 64u;

// Distance within which an eye counts as being beside a plane and not in it [m].
const LEAST_DISTANCE = 1e-6;

// Pixels by which the area of a triangle is larger than its corners say, against rounding.
const MARGIN = 0.05;

// Beyond all inverse depths [1/m].
const BEYOND = 3e38;

@compute @workgroup_size(LANES)
fn plot(@builtin(workgroup_id) group: vec3<u32>, @builtin(local_invocation_index) lane: u32) {
    let view = views[group.x];
    let scene = scenes[view.scene];
    let of_faces = group.x * camera.stride;
    let of_areas = of_faces + scene.faces;
    let of_rounds = of_areas + scene.bodies + scene.triangles;
    let of_triangles = of_rounds + 3u * scene.rounds;
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
    for (var index = lane; index < scene.triangles; index += LANES) {
        let facet = plotted_triangle(view, triangles[scene.first_triangle + index]);
        plots[of_areas + scene.bodies + index] = facet.area;
        plots[of_triangles + 4u * index] = facet.inverse;
        for (var edge = 0u; edge < 3u; edge++) {
            plots[of_triangles + 4u * index + 1u + edge] = bitcast<vec4<u32>>(facet.edges[edge]);
        }
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

// A triangle that faces the eye.
struct Facet {
    // As of a body.
    area: vec4<u32>,
    // As of a face.
    inverse: vec4<u32>,
    // Base, per column, per row of what is nowhere negative in it; then its least and greatest inverse depth.
    edges: array<vec4<f32>, 3>,
}

fn plotted_triangle(view: View, triangle: Triangle) -> Facet {
    var facet: Facet;
    facet.inverse = plotted_face(view, triangle.face);
    var depths: vec3<f32>;
    var low = vec2(BEYOND);
    var high = vec2(-BEYOND);
    let size = vec2<f32>(camera.size);
    for (var index = 0u; index < 3u; index++) {
        let corner = -away(view, corners[triangle.corners[index]].xyz, vec3(0.0));
        depths[index] = dot(corner, view.forward);
        let across = vec2(dot(corner, view.right), dot(corner, view.down));
        let share = across / (max(depths[index], camera.near_m) * camera.tangents);
        let place = 0.5 * (share + 1.0) * size - camera.sample;
        low = min(low, place);
        high = max(high, place);
        facet.edges[index] = vec4(edge(view, triangle.corners[index], triangle.corners[(index + 1u) % 3u]), 0.0);
    }
    let least = min(min(depths.x, depths.y), depths.z);
    let greatest = max(max(depths.x, depths.y), depths.z);
    if facet.inverse.w == 0u || greatest <= camera.near_m {
        return facet;
    }
    facet.edges[0].w = 1.0 / greatest;
    if least <= camera.near_m {
        facet.edges[1].w = BEYOND;
        facet.area = vec4(vec2(0u), camera.size);
        return facet;
    }
    facet.edges[1].w = 1.0 / least;
    let first = vec2<u32>(clamp(ceil(low - MARGIN), vec2(0.0), size));
    let end = vec2<u32>(clamp(floor(high + MARGIN) + 1.0, vec2(0.0), size));
    facet.area = select(vec4(0u), vec4(first, end), all(first < end));
    return facet;
}

// On which side of the edge rays pass. The two triangles beside it have the same terms, of which one takes the other sign,
// so that no pixel falls between them.
fn edge(view: View, start: u32, end: u32) -> vec3<f32> {
    let one = away(view, corners[min(start, end)].xyz, vec3(0.0));
    let other = away(view, corners[max(start, end)].xyz, vec3(0.0));
    let normal = cross(other, one);
    let terms = vec3(dot(normal, view.corner), dot(normal, view.per_column), dot(normal, view.per_row));
    return select(-terms, terms, start < end);
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
