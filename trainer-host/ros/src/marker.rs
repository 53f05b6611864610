//! What is in the world, to be looked at.

use kestrel_core::airframe::Airframe;
use kestrel_sim::outline::Outline;
use kestrel_sim::world::{self, Floor, Mesh, Shape, Solid, World};
use nalgebra::Vector3;

use crate::bag::stamp;
use crate::message::{Colour, Header, Marker, MarkerArray, Pose, Quaternion, Triple};

/// Kinds of markers, numbers of `visualization_msgs/Marker`.
const CUBE: i32 = 1;
const SPHERE: i32 = 2;
const CYLINDER: i32 = 3;
const TRIANGLE_LIST: i32 = 11;

/// Half the side of the drawn floor, and its thickness \[m\].
const FLOOR_HALF: f64 = 10.0;
const FLOOR_THICKNESS: f64 = 0.01;
const FLOOR_COLOUR: [f32; 3] = [0.85, 0.87, 0.9];

/// A drone's body and rotors, and the thickness of both \[m\].
const BODY_COLOUR: [f32; 3] = [0.15, 0.17, 0.2];
const ROTOR_COLOUR: [f32; 3] = [0.18, 0.44, 0.87];
const ROTOR_THICKNESS: f64 = 0.003;

/// Frame of a movable body.
pub(crate) fn movable_frame(index: usize) -> String {
    format!("movable{index}")
}

/// Frame of a drone, and the beginning of its topics.
pub(crate) fn drone_frame(index: usize) -> String {
    format!("drone{index}")
}

/// Everything that can be seen, each in the frame with which it moves.
pub(crate) fn markers(world: &World, airframe: &Airframe, drones: usize) -> MarkerArray {
    let mut markers = Vec::new();
    if world.floor == Floor::Solid {
        let below = Vector3::new(0.0, 0.0, -0.5 * FLOOR_THICKNESS);
        let half = Vector3::new(FLOOR_HALF, FLOOR_HALF, 0.5 * FLOOR_THICKNESS);
        markers.push(of_shape(&Shape::Cuboid(half), &world::Pose::at(below), FLOOR_COLOUR));
    }
    markers.extend(world.solids.iter().map(of_solid));
    for (index, movable) in world.movables.iter().enumerate() {
        let place = world::Pose::at(Vector3::zeros());
        let solid = Solid { pose: place, ..movable.solid.clone() };
        markers.push(locked(of_solid(&solid), &movable_frame(index)));
    }
    for drone in 0..drones {
        markers.extend(of_drone(airframe).map(|marker| locked(marker, &drone_frame(drone))));
    }
    for (id, marker) in markers.iter_mut().enumerate() {
        marker.id = id as i32;
    }
    MarkerArray { markers }
}

/// Moves with a frame.
fn locked(marker: Marker, frame: &str) -> Marker {
    Marker { header: Header::new(stamp(0.0), frame), frame_locked: true, ..marker }
}

/// A body and four rotors.
fn of_drone(airframe: &Airframe) -> [Marker; 5] {
    let body = Vector3::new(0.35 * airframe.arm, 0.35 * airframe.arm, 0.5 * airframe.collision_height);
    let body = of_shape(&Shape::Cuboid(body), &world::Pose::at(Vector3::zeros()), BODY_COLOUR);
    let [a, b, c, d] = airframe.rotor_positions().map(|[x, y]| {
        let disc = Shape::Cylinder { radius: airframe.propeller_radius, half_height: 0.5 * ROTOR_THICKNESS };
        let top = 0.5 * airframe.collision_height;
        of_shape(&disc, &world::Pose::at(Vector3::new(x, y, top)), ROTOR_COLOUR)
    });
    [body, a, b, c, d]
}

fn of_solid(solid: &Solid) -> Marker {
    let (shape, pose) = solid.seen();
    Marker { text: solid.name.clone(), ..of_shape(shape, &pose, solid.colour) }
}

fn of_shape(shape: &Shape, pose: &world::Pose, colour: [f32; 3]) -> Marker {
    let unit = Triple { x: 1.0, y: 1.0, z: 1.0 };
    let (kind, scale, points, colours) = match shape {
        Shape::Cuboid(half) => (CUBE, Triple::from(2.0 * half), Vec::new(), Vec::new()),
        Shape::Sphere(radius) => (SPHERE, Triple::from([2.0 * radius; 3]), Vec::new(), Vec::new()),
        Shape::Cylinder { radius, half_height } => {
            (CYLINDER, Triple::from([2.0 * radius, 2.0 * radius, 2.0 * half_height]), Vec::new(), Vec::new())
        }
        Shape::Hull(_) => (TRIANGLE_LIST, unit, fans(shape), Vec::new()),
        Shape::Mesh(mesh) => {
            let (points, colours) = triangles(mesh, colour);
            (TRIANGLE_LIST, unit, points, colours)
        }
    };
    Marker {
        header: Header::new(stamp(0.0), "world"),
        namespace: "kestrel".to_owned(),
        kind,
        pose: Pose::of(pose),
        scale,
        colour: Colour::opaque(colour),
        points,
        colours,
        ..Marker::default()
    }
}

/// The faces of a hull as triangles.
fn fans(shape: &Shape) -> Vec<Triple> {
    let faces = Outline::of(shape).faces;
    let triangles = faces.iter().flat_map(|face| {
        (1..face.len().saturating_sub(1)).flat_map(move |corner| [face[0], face[corner], face[corner + 1]])
    });
    triangles.map(|point| Triple::from(point.cast::<f64>())).collect()
}

/// Corners of a mesh's triangles, each with its colour.
fn triangles(mesh: &Mesh, colour: [f32; 3]) -> (Vec<Triple>, Vec<Colour>) {
    let corners = mesh.triangles.iter().flat_map(|triangle| {
        let colour = Colour::opaque(triangle.colour.unwrap_or(colour));
        mesh.places(triangle).map(|place| (Triple::from(place), colour))
    });
    corners.unzip()
}

impl Pose {
    pub(crate) fn of(pose: &world::Pose) -> Self {
        let attitude = pose.world_from_body;
        let orientation = Quaternion { x: attitude.x, y: attitude.y, z: attitude.z, w: attitude.w };
        Self { position: Triple::from(pose.position), orientation }
    }
}

impl Colour {
    fn opaque([r, g, b]: [f32; 3]) -> Self {
        Self { r, g, b, a: 1.0 }
    }
}
