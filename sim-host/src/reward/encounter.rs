use crate::term::prelude::*;

/// How near the drone's centre comes to the surface of a mate or a person within the next seconds if nobody changes its velocity,
/// as `(1 - d / reach)²` of the least distance d on the way: nothing where d is beyond the reach, more than one where they would
/// touch. Of all it is the one that comes nearest. A mate is a ball of the radius of its hull; a
/// person is as high as the room, so that nobody is flown over.
///
/// Gradients through the physics know it: how the others move counts as given.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Encounter {
    /// What one unit is worth.
    pub weight: f64,
    /// Distance from which on it is nothing.
    pub reach_m: f64,
    /// How far ahead it looks.
    pub ahead_secs: f64,
}

const AHEAD: Limits = Limits::above(0.0, 10.0, "s");

/// Who does not move at all against the other stays as far away.
const STILL: f32 = 1e-9;

impl Term for Encounter {
    const PAID: Paid = Paid::PerSecond;

    fn check(&self, _: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("reach_m").number(self.reach_m, &Limits::above(0.0, 10.0, "m"))?;
        field.at("ahead_secs").number(self.ahead_secs, &AHEAD).map(drop)
    }

    fn looks_ahead_secs(&self) -> Option<f64> {
        Some(self.ahead_secs)
    }

    #[inline(always)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let Some([x, y, z, radius, ux, uy, uz]) = view.passing else {
            values.fill(R::zero());
            return;
        };
        let per_reach = R::one() / R::from_f32(self.reach_m as f32);
        let (ahead, still) = (R::from_f32(self.ahead_secs as f32), R::from_f32(STILL));
        let ([px, py, pz], [vx, vy, vz]) = (&view.swarm.position, &view.swarm.velocity);
        each(values, |i| {
            let offset = Vector3::new(px[i] - x[i], py[i] - y[i], pz[i] - z[i]);
            let closing = Vector3::new(vx[i] - ux[i], vy[i] - uy[i], vz[i] - uz[i]);
            let along = (offset.x * closing.x + offset.y * closing.y) + offset.z * closing.z;
            let secs = (-along / (square(&closing) + still)).limited(R::zero(), ahead);
            let nearest = Vector3::new(
                offset.x + closing.x * secs,
                offset.y + closing.y * secs,
                offset.z + closing.z * secs,
            );
            let distance = (square(&nearest) + still).sqrt() - radius[i];
            let near = (R::one() - distance * per_reach).at_least(R::zero());
            worth * (near * near)
        });
    }
}

#[inline(always)]
fn square<R: Real>(vector: &Vector3<R>) -> R {
    (vector.x * vector.x + vector.y * vector.y) + vector.z * vector.z
}

#[cfg(test)]
mod tests {
    use super::super::trial::{Trial, assert_near};

    #[test]
    fn who_is_going_to_be_met_counts_before_it_is_near() {
        let mut trial = Trial::of("encounter: { weight: -48, reach_m: 0.5, ahead_secs: 1 }");
        // Somebody of 20 cm at x = 2 who walks to the side.
        trial.passing = Some([[2.0], [0.0], [1.0], [0.2], [0.0], [1.0], [0.0]]);
        for (place, velocity, expected) in [
            // In a second at x = 1.7, which is beyond the reach of one who has gone aside by a metre.
            ([0.0, 0.0, 1.0], [1.7, 0.0, 0.0], 0.0),
            // As fast to the side: there, 10 cm from its surface.
            ([0.0, 0.0, 1.0], [1.7, 1.0, 0.0], 0.8 * 0.8),
            // Away from there.
            ([0.0, 0.0, 1.0], [-1.7, 1.0, 0.0], 0.0),
            // Beside it, at rest against it.
            ([1.6, 0.0, 1.0], [0.0, 1.0, 0.0], 0.6 * 0.6),
            // Through it, 10 cm beside its middle.
            ([1.0, 0.1, 1.0], [2.0, 1.0, 0.0], 1.2 * 1.2),
        ] {
            trial.moving(velocity);
            let paid = trial.at(place[0], place[1], place[2]);
            assert!((paid + expected).abs() < 1e-6, "{paid}, not -{expected}");
        }
        trial.passing = None;
        assert_near(trial.at(1.9, 0.0, 1.0), 0.0);
    }
}
