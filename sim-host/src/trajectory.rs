//! Closed curves that goals follow: circles, figure-eights, Lissajous figures, trefoils and random ones.
//!
//! Every shape is a trigonometric polynomial of degree three, so that all are computed, and differentiated, alike.

use core::array::from_fn;

use kestrel_core::real::Real;
use nalgebra::Vector3;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use crate::seed::Stream;

/// Harmonics of each axis.
const DEGREE: usize = 3;

/// Points of a curve that are looked at for its size and its greatest speed.
const SAMPLES: u32 = 96;

/// Numbers of a [`Trajectory`].
pub(crate) const TRAJECTORY_LEN: usize = 6 * DEGREE + 1;

/// What the curve of an episode looks like from above.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize, Serialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TrajectoryShape {
    /// Once around.
    Circle,
    /// Gerono's lemniscate.
    FigureEight,
    /// Three times across while twice along.
    Lissajous,
    /// Three leaves.
    Trefoil,
    /// Harmonics of random amplitude and phase, the k-th of order 1/k.
    Random,
}

/// From which curves an episode draws its own.
#[derive(Clone, Debug, PartialEq)]
pub struct Trajectories {
    /// Shapes, each as likely as the others.
    pub shapes: Vec<TrajectoryShape>,
    /// Least and greatest distance that a curve reaches from its centre, seen from above \[m\].
    pub reach: [f32; 2],
    /// Least and greatest height that it rises above its centre, and sinks below \[m\].
    pub rise: [f32; 2],
    /// Least and greatest of the greatest speed on it \[m/s\].
    pub speed: [f32; 2],
}

/// The curve of one episode, about its centre: along each axis the cosines, then the sines of one, two and three times an
/// angle that grows with time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Trajectory<R> {
    /// \[m\].
    harmonics: [[R; 2 * DEGREE]; 3],
    /// \[rad/s\].
    rate: R,
}

/// What a policy sees of the way ahead; see [`Self::len`] and [`Self::PATH_POINT_LEN`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PathAhead {
    /// How many points.
    pub points: usize,
    /// Time from one to the next, and from now to the first \[s\].
    pub spacing_secs: f32,
    /// Distance that reads as one \[m\].
    pub position_scale_m: f32,
}

impl PathAhead {
    /// Values of a point: where it is from the drone, in its body axes.
    pub const PATH_POINT_LEN: usize = 3;

    /// Number of values.
    #[expect(clippy::len_without_is_empty, reason = "some point is always seen")]
    pub const fn len(&self) -> usize {
        Self::PATH_POINT_LEN * self.points
    }
}

impl Trajectories {
    /// The curve of an episode.
    pub(crate) fn draw<R: Real>(&self, stream: &mut Stream) -> Trajectory<R> {
        let shape = self.shapes[stream.below(self.shapes.len() as u32) as usize];
        let mut between = |[least, most]: [f32; 2]| f64::from(stream.between(least, most));
        let (reach, rise, speed) = (between(self.reach), between(self.rise), between(self.speed));
        let turn = |share: f32| core::f64::consts::TAU * f64::from(share);
        let (heading, phase) = (turn(stream.uniform()), turn(stream.uniform()));
        let curve = Trajectory { harmonics: shape.harmonics(stream), rate: 1.0 };
        let widest = curve.greatest(|(place, _)| place.xy().norm());
        let curve =
            Trajectory { harmonics: curve.harmonics.map(|axis| axis.map(|of| of * reach / widest)), ..curve };
        let mut curve = curve.turned(heading);
        // Up and down once on the way around.
        curve.harmonics[2][DEGREE] = rise;
        let curve = curve.begun_at(phase);
        let fastest = curve.greatest(|(_, velocity)| velocity.norm());
        Trajectory {
            harmonics: curve.harmonics.map(|axis| axis.map(R::from_f64)),
            rate: R::from_f64(speed / fastest),
        }
    }
}

impl TrajectoryShape {
    /// All of them.
    pub const ALL: [Self; 5] = [Self::Circle, Self::FigureEight, Self::Lissajous, Self::Trefoil, Self::Random];

    /// Cosines, then sines along x and y, in any size.
    fn harmonics(self, stream: &mut Stream) -> [[f64; 2 * DEGREE]; 3] {
        let flat = |x, y| [x, y, [0.0; 2 * DEGREE]];
        match self {
            Self::Circle => flat([1.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0, 0.0, 0.0]),
            Self::FigureEight => flat([1.0, 0.0, 0.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 0.5, 0.0]),
            Self::Lissajous => flat([0.0, 0.0, 1.0, 0.0, 0.0, 0.0], [0.0, 0.0, 0.0, 0.0, 1.0, 0.0]),
            Self::Trefoil => flat([0.0, 0.0, 0.0, 1.0, 2.0, 0.0], [1.0, -2.0, 0.0, 0.0, 0.0, 0.0]),
            Self::Random => {
                let mut axis = || from_fn(|index| f64::from(stream.normal()) / (index % DEGREE + 1) as f64);
                flat(axis(), axis())
            }
        }
    }
}

impl Trajectory<f64> {
    /// The greatest of something over the curve.
    fn greatest(&self, of: impl Fn((Vector3<f64>, Vector3<f64>)) -> f64) -> f64 {
        let period = core::f64::consts::TAU / self.rate;
        let samples = (0..SAMPLES).map(|sample| of(self.at(period * f64::from(sample) / f64::from(SAMPLES))));
        samples.fold(f64::MIN_POSITIVE, f64::max)
    }

    /// Turned about the vertical \[rad\].
    fn turned(self, heading: f64) -> Self {
        let (sine, cosine) = libm::sincos(heading);
        let [x, y, z] = self.harmonics;
        let turned = |[a, b]: [f64; 2]| [cosine * a - sine * b, sine * a + cosine * b];
        let both: [[f64; 2]; 2 * DEGREE] = from_fn(|index| turned([x[index], y[index]]));
        Self { harmonics: [both.map(|[along, _]| along), both.map(|[_, across]| across), z], ..self }
    }

    /// The same curve from another place on it, `phase` \[rad\] later.
    fn begun_at(self, phase: f64) -> Self {
        let begun = |axis: [f64; 2 * DEGREE]| {
            let mut begun = axis;
            for harmonic in 0..DEGREE {
                let (sine, cosine) = libm::sincos((harmonic + 1) as f64 * phase);
                let (of_cosine, of_sine) = (axis[harmonic], axis[DEGREE + harmonic]);
                begun[harmonic] = of_cosine * cosine + of_sine * sine;
                begun[DEGREE + harmonic] = of_sine * cosine - of_cosine * sine;
            }
            begun
        };
        Self { harmonics: self.harmonics.map(begun), ..self }
    }
}

impl<R: Real> Trajectory<R> {
    /// Position \[m\] from the centre and velocity \[m/s\] after a time \[s\], world.
    #[inline(always)]
    pub fn at(&self, secs: R) -> (Vector3<R>, Vector3<R>) {
        let (sine, cosine) = (self.rate * secs).sin_cos();
        let two = R::from_f32(2.0);
        // Sines and cosines of the sums of angles.
        let (sine_of_two, cosine_of_two) = (two * sine * cosine, R::one() - two * sine * sine);
        let sine_of_three = sine_of_two * cosine + cosine_of_two * sine;
        let cosine_of_three = cosine_of_two * cosine - sine_of_two * sine;
        let three = R::from_f32(3.0);
        let place = |[a, b, c, d, e, f]: [R; 2 * DEGREE]| {
            (a * cosine + b * cosine_of_two + c * cosine_of_three)
                + (d * sine + e * sine_of_two + f * sine_of_three)
        };
        let speed = |[a, b, c, d, e, f]: [R; 2 * DEGREE]| {
            let by_cosines = d * cosine + two * (e * cosine_of_two) + three * (f * cosine_of_three);
            let by_sines = a * sine + two * (b * sine_of_two) + three * (c * sine_of_three);
            self.rate * (by_cosines - by_sines)
        };
        let ([x, y, z], [u, v, w]) = (self.harmonics.map(place), self.harmonics.map(speed));
        (Vector3::new(x, y, z), Vector3::new(u, v, w))
    }

    /// Its numbers, for columns.
    pub(crate) fn to_array(self) -> [R; TRAJECTORY_LEN] {
        from_fn(|index| self.harmonics.as_flattened().get(index).copied().unwrap_or(self.rate))
    }

    /// That of these numbers.
    #[inline(always)]
    pub(crate) fn from_array(numbers: &[R; TRAJECTORY_LEN]) -> Self {
        let harmonics = from_fn(|axis| from_fn(|index| numbers[2 * DEGREE * axis + index]));
        Self { harmonics, rate: numbers[TRAJECTORY_LEN - 1] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seed::{Purpose, Seed};

    fn drawn(shapes: &[TrajectoryShape], count: u32) -> Vec<Trajectory<f64>> {
        let trajectories =
            Trajectories { shapes: shapes.to_vec(), reach: [0.5, 1.0], rise: [0.0, 0.2], speed: [0.5, 1.5] };
        (0..count).map(|number| trajectories.draw(&mut Stream::new(Seed(7), number, Purpose::Reset))).collect()
    }

    #[test]
    fn curves_reach_as_far_and_fly_as_fast_as_they_are_asked_to() {
        for shape in TrajectoryShape::ALL {
            for curve in drawn(&[shape], 50) {
                let farthest = curve.greatest(|(place, _)| place.xy().norm());
                assert!((0.49..1.001).contains(&farthest), "{shape:?}: {farthest} m");
                let fastest = curve.greatest(|(_, velocity)| velocity.norm());
                assert!((0.49..1.501).contains(&fastest), "{shape:?}: {fastest} m/s");
                let highest = curve.greatest(|(place, _)| place.z.abs());
                assert!(highest < 0.201, "{shape:?}: {highest} m");
            }
        }
    }

    #[test]
    fn velocities_are_derivatives_and_curves_close() {
        for curve in drawn(&TrajectoryShape::ALL, 40) {
            let step = 1e-5;
            for secs in [0.0, 0.7, 3.1] {
                let by_difference = (curve.at(secs + step).0 - curve.at(secs - step).0) / (2.0 * step);
                assert!((by_difference - curve.at(secs).1).norm() < 1e-6);
            }
            let around = core::f64::consts::TAU / curve.rate;
            assert!((curve.at(around).0 - curve.at(0.0).0).norm() < 1e-9);
        }
    }

    #[test]
    fn a_circle_keeps_its_radius_and_a_figure_eight_crosses_its_centre() {
        let flat = |shape| {
            let trajectories =
                Trajectories { shapes: vec![shape], reach: [1.0; 2], rise: [0.0; 2], speed: [1.0; 2] };
            trajectories.draw::<f64>(&mut Stream::new(Seed(1), 0, Purpose::Reset))
        };
        let circle = flat(TrajectoryShape::Circle);
        assert!((0..9).all(|secs| (circle.at(f64::from(secs)).0.norm() - 1.0).abs() < 1e-6));
        let eight = flat(TrajectoryShape::FigureEight);
        let nearest = (0..4000).map(|step| eight.at(f64::from(step) * 2e-3).0.norm()).fold(1.0, f64::min);
        assert!(nearest < 2e-3, "{nearest}");
    }

    #[test]
    fn numbers_survive_the_columns_and_single_precision_is_close() {
        for curve in drawn(&TrajectoryShape::ALL, 10) {
            assert_eq!(Trajectory::from_array(&curve.to_array()), curve);
            let single = Trajectory::<f32>::from_array(&curve.to_array().map(|number| number as f32));
            let (exact, rounded) = (curve.at(8.0).0, single.at(8.0).0.cast::<f64>());
            assert!((exact - rounded).norm() < 2e-5);
        }
    }
}
