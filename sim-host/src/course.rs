//! Gates that a drone flies through, one after the other.

use core::f64::consts::FRAC_PI_2;

use kestrel_core::attitude::Attitude;
use nalgebra::Vector3;

use crate::world::{Pose, Shape, Solid};

/// Depth of a gate's frame \[m\].
const DEPTH_M: f64 = 0.05;

/// Red, green and blue of gates.
const COLOUR: [f32; 3] = [0.95, 0.55, 0.1];

/// An upright frame to fly through.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Gate {
    /// Middle of its opening \[m, world\].
    pub center: Vector3<f64>,
    /// Which way it is flown through, about the world z axis, zero along +x \[rad\].
    pub heading: f64,
    /// Width and height of its opening \[m\].
    pub opening: [f64; 2],
}

impl Gate {
    /// Unit vector of the way through it, world.
    pub fn forward(&self) -> Vector3<f64> {
        let (sine, cosine) = libm::sincos(self.heading);
        Vector3::new(cosine, sine, 0.0)
    }

    /// The point so far behind it on its axis \[m, world\], before it where that is negative.
    pub fn on_axis(&self, behind_m: f64) -> Vector3<f64> {
        self.center + self.forward() * behind_m
    }

    /// Whether the straight line from one point to another \[m, world\] leads through its opening, forwards.
    pub fn is_passed(&self, from: &Vector3<f64>, to: &Vector3<f64>) -> bool {
        let (from, to) = (self.seen(from), self.seen(to));
        let leads_forwards = from.x < 0.0 && 0.0 <= to.x;
        if !leads_forwards {
            return false;
        }
        let crossing = from + (to - from) * (from.x / (from.x - to.x));
        crossing.y.abs() < self.opening[0] / 2.0 && crossing.z.abs() < self.opening[1] / 2.0
    }

    /// Its four bars, this wide \[m\].
    pub fn frame(&self, name: &str, bar_m: f64) -> Vec<Solid> {
        let [half_width, half_height] = self.opening.map(|size| size / 2.0);
        let (aside, above) = (half_width + bar_m / 2.0, half_height + bar_m / 2.0);
        let bar = |left: f64, up: f64, half: [f64; 2]| Solid {
            shape: Shape::Cuboid(Vector3::new(DEPTH_M / 2.0, half[0], half[1])),
            pose: Pose { position: self.place(left, up), world_from_body: self.attitude() },
            colour: COLOUR,
            ..Solid::block(name, Vector3::zeros(), Vector3::zeros())
        };
        let upright = [bar_m / 2.0, half_height + bar_m];
        let across = [half_width, bar_m / 2.0];
        vec![
            bar(aside, 0.0, upright),
            bar(-aside, 0.0, upright),
            bar(0.0, above, across),
            bar(0.0, -above, across),
        ]
    }

    fn attitude(&self) -> Attitude<f64> {
        Attitude::from_axis_angle(Vector3::z(), self.heading)
    }

    /// The point of its plane so far to the left of and above its middle \[m, world\].
    fn place(&self, left: f64, up: f64) -> Vector3<f64> {
        let (sine, cosine) = libm::sincos(self.heading + FRAC_PI_2);
        self.center + Vector3::new(cosine * left, sine * left, up)
    }

    /// A point from its middle \[m\]: forwards, to the left, up.
    pub fn seen(&self, point: &Vector3<f64>) -> Vector3<f64> {
        self.attitude().rotate_inverse(point - self.center)
    }
}

/// What a drone is told of the next gates: where it is itself, seen from the middle of each (forwards, to the left, up), and the
/// cosine and sine of the heading in which the gate is flown through. Behind the last gate the last one is told again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GatesAhead {
    /// How many gates, at least one.
    pub gates: usize,
    /// Distance that reads as one \[m\].
    pub position_scale_m: f32,
}

impl GatesAhead {
    /// Values of a gate.
    pub const GATE_LEN: usize = 5;

    /// Number of values.
    #[expect(clippy::len_without_is_empty, reason = "some gate is always told")]
    pub const fn len(&self) -> usize {
        Self::GATE_LEN * self.gates
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// At (1, 2, 1), flown through towards +y, 80 cm wide and 60 cm high.
    const GATE: Gate = Gate { center: Vector3::new(1.0, 2.0, 1.0), heading: FRAC_PI_2, opening: [0.8, 0.6] };

    fn is_passed(from: [f64; 3], to: [f64; 3]) -> bool {
        GATE.is_passed(&from.into(), &to.into())
    }

    #[test]
    fn it_is_passed_forwards_through_its_opening_only() {
        assert!(is_passed([1.3, 1.9, 1.2], [1.3, 2.1, 1.2]));
        assert!(is_passed([1.0, 1.9, 1.0], [1.0, 2.0, 1.0]), "its plane belongs to what lies behind");
        assert!(!is_passed([1.3, 2.1, 1.2], [1.3, 1.9, 1.2]), "backwards");
        assert!(!is_passed([1.0, 1.8, 1.0], [1.0, 1.9, 1.0]), "not there yet");
        assert!(!is_passed([1.0, 2.0, 1.0], [1.0, 2.1, 1.0]), "already behind it");
        assert!(!is_passed([1.45, 1.9, 1.0], [1.45, 2.1, 1.0]), "beside it");
        assert!(!is_passed([1.0, 1.9, 1.35], [1.0, 2.1, 1.35]), "above it");
        // The line counts where it crosses the plane, not where it ends.
        assert!(is_passed([1.0, 1.9, 1.0], [2.0, 5.0, 1.0]));
        assert!(!is_passed([0.0, 0.0, 1.0], [1.0, 2.01, 1.0].map(|axis| 2.0 * axis)));
    }

    #[test]
    fn its_frame_leaves_the_opening_free_and_nothing_else() {
        let frame = GATE.frame("gate", 0.1);
        let extent = frame.iter().map(Solid::extent).reduce(|(low, high), (a, b)| (low.inf(&a), high.sup(&b)));
        let (low, high) = extent.unwrap();
        assert!((low - Vector3::new(0.5, 1.975, 0.6)).norm() < 1e-12, "{low}");
        assert!((high - Vector3::new(1.5, 2.025, 1.4)).norm() < 1e-12, "{high}");
        let holds = |x: f64, z: f64| {
            let point = Vector3::new(x, 2.0, z);
            let inside =
                |(low, high): (Vector3<f64>, Vector3<f64>)| point.inf(&high) == point && point.sup(&low) == point;
            frame.iter().any(|bar| inside(bar.extent()))
        };
        for (x, z, solid) in [(1.0, 1.0, false), (1.39, 1.29, false), (1.41, 1.0, true), (1.0, 0.69, true)] {
            assert_eq!(holds(x, z), solid, "{x} {z}");
        }
    }
}
