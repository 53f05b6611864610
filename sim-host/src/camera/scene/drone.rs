//! A drone made of primitives.

use kestrel_core::airframe::Airframe;
use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;

use crate::world::{Pose, Role, Shape, Solid};

/// Half the length, width and height of the body of a Crazyflie with its battery \[m\], and the length of the arm to which
/// that belongs; those of other airframes are in proportion.
const BODY: [f64; 3] = [0.016, 0.011, 0.006];
const BODY_ARM: f64 = 0.0397;

/// Half the width and height of an arm, the height of the discs over the centre of mass, and half their thickness, all
/// per length of the arm: 4 mm, 2 mm, 12 mm and 1 mm on a Crazyflie.
const ARM: [f64; 2] = [0.1, 0.05];
const DISC_HEIGHT: f64 = 0.3;
const DISC_HALF: f64 = 0.025;

const BODY_COLOUR: [f32; 3] = [0.16, 0.19, 0.23];
const ARM_COLOUR: [f32; 3] = [0.3, 0.33, 0.37];
/// Of the arms that are ahead.
const NOSE_COLOUR: [f32; 3] = [0.9, 0.24, 0.31];

/// Of the rotors of the first drone, the second and so on, then from the beginning: those of the trails in films.
const ROTOR_COLOURS: [[f32; 3]; 6] = [
    [0.94, 0.5, 0.18],
    [0.11, 0.56, 0.84],
    [0.18, 0.63, 0.26],
    [0.84, 0.2, 0.52],
    [0.65, 0.49, 0.0],
    [0.0, 0.6, 0.66],
];

/// Body, arms and rotors around the centre of mass, front along x.
pub(super) fn drone(airframe: &Airframe, index: usize) -> Vec<Solid> {
    let scale = airframe.arm;
    let body = Shape::Cuboid(Vector3::from(BODY) * (scale / BODY_ARM));
    let rotors = airframe.rotor_positions();
    let arms = rotors.map(|[x, y]| arm(Vector3::new(x, y, 0.0), scale));
    let discs = rotors.map(|[x, y]| {
        let shape = Shape::Cylinder { radius: airframe.propeller_radius, half_height: DISC_HALF * scale };
        let place = Pose::at(Vector3::new(x, y, DISC_HEIGHT * scale));
        part(shape, place, ROTOR_COLOURS[index % ROTOR_COLOURS.len()])
    });
    let body = part(body, Pose::at(Vector3::zeros()), BODY_COLOUR);
    [body].into_iter().chain(arms).chain(discs).collect()
}

/// From the centre to below a rotor.
fn arm(end: Vector3<f64>, scale: f64) -> Solid {
    let [width, height] = ARM.map(|share| share * scale);
    let shape = Shape::Cuboid(Vector3::new(0.5 * end.norm(), width, height));
    let world_from_body = Attitude::from_axis_angle(Vector3::z(), libm::atan2(end.y, end.x));
    let colour = if end.x > 1e-3 { NOSE_COLOUR } else { ARM_COLOUR };
    part(shape, Pose { position: 0.5 * end, world_from_body }, colour)
}

fn part(shape: Shape, pose: Pose, colour: [f32; 3]) -> Solid {
    Solid {
        name: String::new(),
        shape,
        pose,
        role: Role::Decoration,
        friction: 0.0,
        contact_gap: 0.0,
        colour,
        visual: None,
    }
}
