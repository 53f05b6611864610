//! Where the nearest team mates are and how they move: what a swarm tells each other by radio, or a camera sees.

use kestrel_core::real::Real;
use nalgebra::Vector3;

use super::instrument::Sampling;
use crate::seed::Stream;
use crate::swarm::{Column, row, set_row};

/// Values of one mate.
const MATE_LEN: usize = 6;

/// The nearest team mates, the nearest first; six values of each, in the world's axes or in the drone's:
///
/// | index | value | unit of one |
/// |---|---|---|
/// | 0–2 | position less the drone's own; its length is limited to 1 | `position_scale_m` |
/// | 3–5 | velocity less the drone's own | `velocity_scale` |
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Mates {
    /// How many, at least one and fewer than the team has drones.
    pub nearest: usize,
    /// Distance that reads as one; of farther mates only the direction is seen \[m\].
    pub position_scale_m: f32,
    /// Speed that reads as one \[m/s\].
    pub velocity_scale: f32,
    /// Whether in the drone's axes, as it knows them.
    pub in_body_axes: bool,
    /// What they say and how often; without it they are always seen as they are.
    pub radio: Option<Radio>,
}

/// Messages in which drones tell each other where they are and how they move.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Radio {
    /// Messages of a mate per second; where they are more than there are control periods, each has one.
    pub rate_hz: f64,
    /// Standard deviation of the position in a message, along each axis \[m\].
    pub noise_m: f32,
    /// Share of the messages of each mate that a drone does not receive, in \[0, 1).
    pub lost: f64,
}

/// Position \[m\] and velocity \[m/s\] of a drone, world.
pub(crate) type Course<R> = (Vector3<R>, Vector3<R>);

/// What the drones of a block, one of each environment, have heard of the mates, by lane.
#[derive(Clone, Debug)]
pub(crate) struct MatesMemory<const LANES: usize, R> {
    radio: Radio,
    /// Share of the time between two messages that had passed when the episode began.
    phase: Column<LANES, R>,
    /// Reading at which they listened last.
    listened: Column<LANES, R>,
    /// Where each of the team is and how it moves by its last message, one's own place unused.
    heard: Vec<[Column<LANES, R>; MATE_LEN]>,
}

impl<const LANES: usize, R: Real> MatesMemory<LANES, R> {
    /// Of a team of so many drones.
    pub(crate) fn new(radio: Radio, drones: usize) -> Self {
        let nothing = [R::zero(); LANES];
        Self { radio, phase: nothing, listened: nothing, heard: vec![[nothing; MATE_LEN]; drones] }
    }

    /// An episode begins, which hears messages at instants of its own.
    pub(crate) fn begin(&mut self, lane: usize, stream: &mut Stream) {
        self.phase[lane] = R::from_f32(stream.uniform());
        self.listened[lane] = R::from_f64(-1.0);
    }

    /// What a drone knows of the `team` at this reading of the episode, counted from zero: of itself the truth, of each mate its
    /// last message, carried on at its velocity. The first message of each arrives.
    pub(crate) fn listen(
        &mut self,
        (own, lane): (usize, usize),
        (reading, control_secs): (u32, f64),
        team: &[Course<R>],
        stream: &mut Stream,
    ) -> Vec<Course<R>> {
        let sampling = Sampling { rate_hz: self.radio.rate_hz, latency_secs: 0.0, drop_out: self.radio.lost };
        let due = sampling.due(u64::from(reading), self.phase[lane].to_f64(), control_secs);
        let is_new = self.listened[lane].to_f64() != f64::from(reading);
        self.listened[lane] = R::from_f64(f64::from(reading));
        let mut known = Vec::with_capacity(team.len());
        for (mate, ((position, velocity), heard)) in team.iter().zip(&mut self.heard).enumerate() {
            if mate == own {
                known.push((*position, *velocity));
                continue;
            }
            let [x, y, z, vx, vy, vz] = row(heard, lane);
            let (mut place, mut moving) = (Vector3::new(x, y, z), Vector3::new(vx, vy, vz));
            if is_new {
                let arrives = due && (f64::from(stream.uniform()) >= sampling.drop_out || reading == 0);
                if arrives {
                    let error = Vector3::from_fn(|_, _| R::from_f32(self.radio.noise_m * stream.normal()));
                    (place, moving) = (position + error, *velocity);
                } else {
                    place += moving * R::from_f64(control_secs);
                }
                set_row(heard, lane, [place.x, place.y, place.z, moving.x, moving.y, moving.z]);
            }
            known.push((place, moving));
        }
        known
    }

    pub(crate) fn columns_mut(&mut self) -> impl Iterator<Item = &mut Column<LANES, R>> {
        [&mut self.phase, &mut self.listened].into_iter().chain(self.heard.iter_mut().flatten())
    }
}

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
    use crate::seed::{Purpose, Seed};

    const MATES: Mates =
        Mates { nearest: 2, position_scale_m: 2.0, velocity_scale: 4.0, in_body_axes: false, radio: None };

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

    /// Errors \[m\] of where the first of a team thinks that its mate is, which flies at 2 m/s, and turns back after a second.
    fn errors(radio: Radio) -> Vec<f64> {
        let (secs, mut stream) = (0.02, Stream::new(Seed(9), 0, Purpose::Reset));
        let mut memory = MatesMemory::<1, f64>::new(radio, 2);
        memory.begin(0, &mut stream);
        let error = |reading: u32| {
            let now = f64::from(reading) * secs;
            let (place, speed) = if now < 1.0 { (2.0 * now, 2.0) } else { (4.0 - 2.0 * now, -2.0) };
            let team = [at(-1.0, 0.0), (Vector3::new(place, 0.0, 1.0), Vector3::new(speed, 0.0, 0.0))];
            let mut listen = || memory.listen((0, 0), (reading, secs), &team, &mut stream);
            let known = listen();
            assert_eq!(known, listen(), "who listens again hears nothing new");
            assert_eq!(known[0], team[0]);
            (known[1].0 - team[1].0).x
        };
        (0..100).map(error).collect()
    }

    #[test]
    fn a_message_holds_until_the_next_and_goes_on_with_its_velocity() {
        let clear = Radio { rate_hz: 10.0, noise_m: 0.0, lost: 0.0 };
        let errors = errors(clear);
        assert!(errors[..50].iter().all(|error| error.abs() < 1e-12), "{errors:?}");
        // After it has turned back a message of before is wrong by 4 m/s, for no longer than 0.1 s.
        assert!((0.05..0.45).contains(&errors[51..56].iter().copied().fold(0.0, f64::max)));
        assert!(errors[56..].iter().all(|error| error.abs() < 1e-12));
    }

    #[test]
    fn messages_are_wrong_and_get_lost_but_for_the_first() {
        let noisy = errors(Radio { rate_hz: 50.0, noise_m: 0.1, lost: 0.0 });
        let deviation = (noisy.iter().map(|error| error * error).sum::<f64>() / 100.0).sqrt();
        assert!((deviation - 0.1).abs() < 0.025, "{deviation} m");
        let lossy = errors(Radio { rate_hz: 50.0, noise_m: 0.1, lost: 0.5 });
        let held = lossy[..50].windows(2).filter(|pair| (pair[0] - pair[1]).abs() < 1e-12).count();
        assert!((15..35).contains(&held), "{held} of 49 were lost");
    }
}
