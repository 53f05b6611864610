//! Where the nearest team mates are and how they move: what a swarm tells each other by radio, or a camera sees.

use kestrel_core::real::Real;
use nalgebra::Vector3;

/// Values of one mate.
const MATE_LEN: usize = 6;

/// The nearest team mates, the nearest first, without noise or delay; six values of each:
///
/// | index | value | unit of one |
/// |---|---|---|
/// | 0–2 | position less the drone's own, world; its length is limited to 1 | `position_scale_m` |
/// | 3–5 | velocity less the drone's own, world | `velocity_scale` |
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mates {
    /// How many, at least one and fewer than the team has drones.
    pub nearest: usize,
    /// Distance that reads as one; of farther mates only the direction is seen \[m\].
    pub position_scale_m: f32,
    /// Speed that reads as one \[m/s\].
    pub velocity_scale: f32,
}

/// Position \[m\] and velocity \[m/s\] of a drone, world.
pub(crate) type Course<R> = (Vector3<R>, Vector3<R>);

impl Mates {
    /// Number of values.
    #[expect(clippy::len_without_is_empty, reason = "some mate is always seen")]
    pub fn len(&self) -> usize {
        MATE_LEN * self.nearest
    }

    /// Writes what the drone `own` of a team sees to `out [values]`. Of mates equally near, the one that follows sooner
    /// in the team, beginning again after its last, comes first.
    pub(crate) fn read<R: Real>(&self, own: usize, team: &[Course<R>], out: &mut [R]) {
        let (position, velocity) = team[own];
        let others = (1..team.len()).map(|place| team[(own + place) % team.len()]);
        let mut seen: Vec<Course<R>> = others.map(|(at, moving)| (at - position, moving - velocity)).collect();
        seen.sort_by(|one, other| square(&one.0).to_f64().total_cmp(&square(&other.0).to_f64()));
        for ((offset, moving), out) in seen.iter().zip(out.chunks_exact_mut(MATE_LEN)) {
            let (place, motion) = out.split_at_mut(3);
            place.copy_from_slice(&self.shown(offset));
            let per_speed = R::one() / R::from_f32(self.velocity_scale);
            motion.copy_from_slice(&[moving.x * per_speed, moving.y * per_speed, moving.z * per_speed]);
        }
    }

    /// An offset \[m\] in units of the scale, no longer than one.
    fn shown<R: Real>(&self, offset: &Vector3<R>) -> [R; 3] {
        let per_metre = R::one() / R::from_f32(self.position_scale_m);
        let [x, y, z] = [offset.x * per_metre, offset.y * per_metre, offset.z * per_metre];
        let shrink = R::one() / ((x * x + y * y) + z * z).at_least(R::one()).sqrt();
        [x * shrink, y * shrink, z * shrink]
    }
}

fn square<R: Real>(vector: &Vector3<R>) -> R {
    (vector.x * vector.x + vector.y * vector.y) + vector.z * vector.z
}

#[cfg(test)]
mod tests {
    use super::*;

    const MATES: Mates = Mates { nearest: 2, position_scale_m: 2.0, velocity_scale: 4.0 };

    fn at(x: f64, speed: f64) -> Course<f64> {
        (Vector3::new(x, 0.0, 1.0), Vector3::new(0.0, speed, 0.0))
    }

    fn read(own: usize, team: &[Course<f64>]) -> [f64; 12] {
        let mut out = [f64::NAN; 12];
        MATES.read(own, team, &mut out);
        out
    }

    #[test]
    fn the_nearest_come_first() {
        let team = [at(0.0, 1.0), at(1.5, 0.0), at(-1.0, 2.0), at(9.0, 0.0)];
        assert_eq!(read(0, &team), [-0.5, 0.0, 0.0, 0.0, 0.25, 0.0, 0.75, 0.0, 0.0, 0.0, -0.25, 0.0]);
        // Far ones keep their direction only.
        assert_eq!(read(3, &team)[..6], [-1.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn of_equally_near_ones_the_next_of_the_team_comes_first() {
        let team = [at(1.0, 0.0), at(0.0, 0.0), at(-1.0, 0.0)];
        assert_eq!([read(1, &team)[0], read(1, &team)[6]], [-0.5, 0.5]);
        let turned = [team[1], team[2], team[0]];
        assert_eq!([read(0, &turned)[0], read(0, &turned)[6]], [-0.5, 0.5]);
    }
}
