//! The drone: frame, rotors coloured by thrust, nose, and the direction of thrust.

use kestrel_core::airframe::Airframe;
use nalgebra::Vector3;

use super::FlightFrame;
use super::canvas::{Depth, Paint};
use super::palette;
use super::view::{Block, Circle, View};

/// Height of the rotor planes over the centre of mass \[m\].
const ROTOR_HEIGHT: f32 = 0.012;

/// Half the length, width and height of the body \[m\].
const BODY_HALVES: [f32; 3] = [0.016, 0.011, 0.005];

/// Length of the line that shows the direction of thrust \[m\].
const THRUST_LINE: f32 = 0.055;

/// Angle by which the drawn blades turn from picture to picture \[rad\]: enough to be seen as spinning.
const BLADE_STEP: f32 = 0.9;

/// Draws the drone, `flown` pictures after its start.
pub(super) fn draw(frame: &FlightFrame, airframe: &Airframe, flown: usize, view: &mut View<'_>) {
    let drone = Placed { frame, airframe };
    drone.draw_frame(view);
    drone.draw_body(view);
    drone.draw_rotors(flown, view);
}

/// Draws the drone's shadow on a level surface at `height` \[m\].
pub(super) fn draw_shadow(frame: &FlightFrame, airframe: &Airframe, height: f32, view: &mut View<'_>) {
    let drone = Placed { frame, airframe };
    let flat = |point: Vector3<f32>| Vector3::new(point.x, point.y, height);
    // The higher the drone, the paler its shadow.
    let paleness = 1.0 + 1.5 * (frame.placement.position.z - height).max(0.0);
    let shade = |opacity: f32| Paint { colour: palette::SHADOW, opacity: opacity / paleness };
    for rotor in 0..4 {
        view.fill(&drone.rotor(rotor).corners().map(flat), shade(0.6), Depth::Tested);
        let arm = [drone.in_world([0.0; 3]), drone.hub(rotor)];
        view.rod(arm.map(flat), 0.006, shade(0.8), Depth::Tested);
    }
}

struct Placed<'a> {
    frame: &'a FlightFrame,
    airframe: &'a Airframe,
}

impl Placed<'_> {
    fn draw_frame(&self, view: &mut View<'_>) {
        let centre = self.in_world([0.0; 3]);
        for rotor in 0..4 {
            let [x, y] = self.rotor_position(rotor);
            let colour = if x > 1e-3 { palette::NOSE } else { palette::INK };
            let end = self.in_world([x, y, 0.0]);
            view.rod([centre, end], 0.0055, Paint::opaque(colour), Depth::Solid);
            view.rod([end, self.hub(rotor)], 0.006, Paint::opaque(palette::INK), Depth::Solid);
        }
    }

    fn draw_body(&self, view: &mut View<'_>) {
        let axes = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        let halves = std::array::from_fn(|axis| self.rotated(axes[axis]) * BODY_HALVES[axis]);
        let body = Block { centre: self.in_world([0.0, 0.0, 0.004]), halves };
        let lightness = [0.1, 0.0, 0.25];
        for (axis, face) in body.faces_towards(view.camera.position) {
            let colour = palette::mix(palette::INK, palette::PAPER, lightness[axis]);
            view.fill(&face, Paint::opaque(colour), Depth::Solid);
        }
        let top = self.in_world([0.0, 0.0, THRUST_LINE]);
        let line = Paint::opaque(palette::MUTED);
        view.rod([self.in_world([0.0, 0.0, 0.009]), top], 0.002, line, Depth::Solid);
        view.ball(top, 0.003, line, Depth::Solid);
    }

    /// Rotors are glass: the farthest first.
    fn draw_rotors(&self, flown: usize, view: &mut View<'_>) {
        let eye = view.camera.position;
        let distance = |rotor: usize| (self.hub(rotor) - eye).norm();
        let mut rotors = [0, 1, 2, 3];
        rotors.sort_by(|&a, &b| distance(b).total_cmp(&distance(a)));
        for rotor in rotors {
            self.draw_rotor(rotor, flown, view);
        }
    }

    fn draw_rotor(&self, rotor: usize, flown: usize, view: &mut View<'_>) {
        let disc = self.rotor(rotor);
        let fraction = self.frame.rotor_fractions[rotor];
        let colour = palette::thrust(fraction * fraction); // thrust grows with the square of the speed
        view.fill(&disc.corners(), Paint { colour, opacity: 0.75 }, Depth::Tested);
        view.ring(
            &disc,
            1.2,
            Paint { colour: palette::mix(palette::INK, colour, 0.75), opacity: 0.9 },
            Depth::Tested,
        );
        let direction = if rotor.is_multiple_of(2) { 1.0 } else { -1.0 };
        let angle = direction * BLADE_STEP * flown as f32;
        let blade = [disc.at(angle), disc.at(angle + std::f32::consts::PI)];
        view.rod(blade, 0.003, Paint { colour: palette::INK, opacity: 0.5 }, Depth::Tested);
    }

    fn rotor(&self, rotor: usize) -> Circle {
        let radius = self.airframe.propeller_radius as f32;
        let radii = [self.rotated([radius, 0.0, 0.0]), self.rotated([0.0, radius, 0.0])];
        Circle { centre: self.hub(rotor), radii }
    }

    fn hub(&self, rotor: usize) -> Vector3<f32> {
        let [x, y] = self.rotor_position(rotor);
        self.in_world([x, y, ROTOR_HEIGHT])
    }

    fn rotor_position(&self, rotor: usize) -> [f32; 2] {
        self.airframe.rotor_positions()[rotor].map(|metres| metres as f32)
    }

    fn in_world(&self, in_body: [f32; 3]) -> Vector3<f32> {
        self.frame.placement.position + self.rotated(in_body)
    }

    fn rotated(&self, in_body: [f32; 3]) -> Vector3<f32> {
        self.frame.placement.attitude.rotate(Vector3::from(in_body))
    }
}
