// Second pass, a workgroup a tile of a view: which bodies its pixels show. The arithmetic of `Tile::draw` on the CPU.

@group(0) @binding(5) var<storage, read> looks: array<Look>;
@group(0) @binding(6) var<storage, read> plots: array<vec4<u32>>;
// Depths, labels and colours, each `[view][row][column]`.
@group(0) @binding(7) var<storage, read_write> pixels: array<u32>;

const TILE = 8u;
const LANES = 64u;

const FLOOR_SURFACE = 1u;

// Beyond all inverse depths [1/m].
const BEYOND = 3e38;

// Direction towards the light; light from everywhere, and onto a surface that faces it.
const LIGHT = vec3(-0.43193421, 0.25916053, 0.86386843);
const AMBIENT = 0.6;
const DIFFUSE = 0.35;
// Light that is mirrored straight up.
const SPECULAR = 0.05;

var<workgroup> found: atomic<u32>;
var<workgroup> listed: array<u32, LANES>;

struct Seen {
    inverse: f32,
    surface: u32,
}

@compute @workgroup_size(TILE, TILE)
fn draw(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
    @builtin(local_invocation_index) lane: u32,
) {
    let scene = scenes[views[group.z].scene];
    let tile = group.xy * TILE;
    let pixel = tile + local.xy;
    let place = vec2<f32>(pixel);
    let of_faces = group.z * camera.stride;
    let of_areas = of_faces + scene.faces;
    let items = scene.bodies + scene.triangles;
    let of_rounds = of_areas + items;
    let of_triangles = of_rounds + 3u * scene.rounds;
    var seen = with_floor(views[group.z], scene, place);
    for (var first = 0u; first < items; first += LANES) {
        if lane == 0u {
            atomicStore(&found, 0u);
        }
        workgroupBarrier();
        if first + lane < items {
            let area = plots[of_areas + first + lane];
            if all(area.xy < tile + TILE) && all(area.zw > tile) {
                listed[atomicAdd(&found, 1u)] = first + lane;
            }
        }
        workgroupBarrier();
        let count = atomicLoad(&found);
        for (var index = 0u; index < count; index++) {
            let item = listed[index];
            if item < scene.bodies {
                seen = with_body(seen, bodies[scene.first_body + item], of_faces, of_rounds, place);
            } else {
                seen = with_triangle(seen, of_triangles + 4u * (item - scene.bodies), place);
            }
        }
        workgroupBarrier();
    }
    if all(pixel < camera.size) {
        show(seen, views[group.z], scene, pixel, group.z);
    }
}

fn with_floor(view: View, scene: Scene, place: vec2<f32>) -> Seen {
    let inverse = at(view.floor, place);
    let meets = scene.has_floor != 0u && inverse > camera.farthest && inverse <= camera.nearest;
    return Seen(select(camera.farthest, inverse, meets), select(0u, FLOOR_SURFACE, meets));
}

fn with_body(seen: Seen, body: Body, of_faces: u32, of_rounds: u32, place: vec2<f32>) -> Seen {
    var enter = Seen(BEYOND, 0u);
    var leave = 0.0;
    for (var index = 0u; index < body.faces; index++) {
        let plot = plots[of_faces + body.first_face + index];
        let value = at(bitcast<vec3<f32>>(plot.xyz), place);
        if plot.w == 0u {
            leave = max(leave, value);
        } else if value < enter.inverse {
            enter = Seen(value, plot.w);
        }
    }
    if body.round != 0u {
        let side = of_rounds + 3u * (body.round - 1u);
        let clipped = clip(side, place);
        if clipped.enter < enter.inverse {
            enter = Seen(clipped.enter, plots[side].w);
        }
        leave = max(leave, clipped.leave);
    }
    if enter.inverse >= leave {
        return nearer(seen, enter);
    }
    return seen;
}

// Bodies and triangles come in any order: among those equally near the first of the scene is seen, as on the CPU.
fn nearer(seen: Seen, other: Seen) -> Seen {
    let is_nearer = other.inverse > seen.inverse || (other.inverse == seen.inverse && other.surface < seen.surface);
    if is_nearer && other.inverse <= camera.nearest {
        return other;
    }
    return seen;
}

fn with_triangle(seen: Seen, facet: u32, place: vec2<f32>) -> Seen {
    let inverse = plots[facet];
    let edges = array(
        bitcast<vec4<f32>>(plots[facet + 1u]),
        bitcast<vec4<f32>>(plots[facet + 2u]),
        bitcast<vec4<f32>>(plots[facet + 3u]),
    );
    let inside = min(min(at(edges[0].xyz, place), at(edges[1].xyz, place)), at(edges[2].xyz, place));
    if inside < 0.0 {
        return seen;
    }
    let value = clamp(at(bitcast<vec3<f32>>(inverse.xyz), place), edges[0].w, edges[1].w);
    return nearer(seen, Seen(value, inverse.w));
}

// What is affine in columns and rows: base, per column, per row.
fn at(affine: vec3<f32>, place: vec2<f32>) -> f32 {
    return affine.x + place.y * affine.z + place.x * affine.y;
}

struct Clipped {
    enter: f32,
    leave: f32,
}

// What of a ray is inside an endless cylinder, or a sphere.
fn clip(side: u32, place: vec2<f32>) -> Clipped {
    let low = bitcast<vec4<f32>>(plots[side + 1u]);
    let last = plots[side + 2u];
    let high = bitcast<vec2<f32>>(last.xy);
    let middle = at(bitcast<vec3<f32>>(plots[side].xyz), place);
    let one = low.x + place.y * (low.z + place.y * high.y);
    let spread = one + place.x * (low.y + place.y * high.x + place.x * low.w);
    let root = sqrt(max(spread, 0.0));
    if last.z == 0u {
        return Clipped(BEYOND, middle + root);
    }
    // A ray beside the cylinder leaves it before it enters.
    return Clipped(middle + root, select(middle - root, BEYOND, spread < 0.0));
}

fn show(seen: Seen, view: View, scene: Scene, pixel: vec2<u32>, index: u32) {
    let look = looks[scene.first_look + seen.surface];
    let depth = select(1.0 / seen.inverse, camera.far_m, seen.surface == 0u);
    let place = vec2<f32>(pixel);
    let ray = (view.corner + place.y * view.per_row) + place.x * view.per_column;
    var colour = look.colour;
    if seen.surface == FLOOR_SURFACE {
        let square = vec2<i32>(floor(view.eye.xy + depth * ray.xy));
        colour = select(scene.even_floor, scene.odd_floor, ((square.x + square.y) & 1) == 1);
    } else if look.round != 0u {
        let round = rounds[scene.first_round + look.round - 1u];
        let away = (view.eye - round.centre) + (view.rest - round.rest) + depth * ray;
        colour = shaded(round.colour, (away - round.axis * dot(away, round.axis)) / round.radius);
    }
    let word = (index * camera.size.y + pixel.y) * camera.size.x + pixel.x;
    pixels[word] = bitcast<u32>(depth);
    pixels[camera.section + word] = look.label;
    pixels[2u * camera.section + word] = colour;
}

// A colour under the light.
fn shaded(colour: vec3<f32>, normal: vec3<f32>) -> u32 {
    let facing = dot(normal, LIGHT);
    let mirrored = max(2.0 * facing * normal.z - LIGHT.z, 0.0);
    let share = AMBIENT + DIFFUSE * max(facing, 0.0) + SPECULAR * mirrored * mirrored;
    let levels = vec3<u32>(clamp(255.0 * colour * share, vec3(0.0), vec3(255.0)));
    return levels.x | levels.y << 8u | levels.z << 16u | 0xff000000u;
}
