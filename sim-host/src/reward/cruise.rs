use crate::rooms::Ways;
use crate::term::prelude::*;

/// Points ahead that are nearer than this \[m\] are flown to more slowly.
const HERE_M: f32 = 0.03;

/// How far the velocity is from the wanted one, as `√(s² + |Δ|²) − s` with Δ in m/s: about half its square by s below, s less
/// than its length above. Wanted is to fly at the cruise speed, slower within a distance of the goal, straight to
/// it, along the way that the drone has found, or along the shortest free one.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Cruise {
    /// What one unit is worth.
    pub weight: f64,
    /// The cruise speed.
    pub speed_m_per_s: f64,
    /// From this distance on the wanted speed falls in proportion to what is left.
    pub slow_within_m: f64,
    /// To this it falls and no further: what is to be touched has to be reached.
    #[serde(default)]
    pub slow_to_m_per_s: f64,
    /// The speed s, below which errors count by their square.
    #[serde(default = "one")]
    pub tolerance_m_per_s: f64,
    /// Whether it leads to the point ahead that the sensor `way` shows.
    #[serde(default)]
    pub along_own_way: bool,
    /// Whether it leads along the shortest free way, which the task knows and the drone need not (that of `advance`).
    #[serde(default)]
    pub along_shortest_way: bool,
    /// What is left of that speed where the way leads aside of the nose or straight up, where who looks ahead sees nothing; in
    /// between the cosine decides.
    #[serde(default = "one")]
    pub share_aside: f64,
    /// To the goal of the task.
    #[serde(skip)]
    pub(crate) ways: Option<Ways>,
}

const fn one() -> f64 {
    1.0
}

impl Term for Cruise {
    const PAID: Paid = Paid::PerSecond;

    fn check(&self, task: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        if self.along_own_way {
            task.needs_own_way(&field.at("along_own_way"))?;
        }
        if self.along_shortest_way {
            if self.along_own_way {
                return Err(field.reject("`along_shortest_way` beside `along_own_way`", "one of them"));
            }
            task.needs_ways("true", "false", &field.at("along_shortest_way"))?;
        }
        let slow = Limits::from(0.0, self.speed_m_per_s, "m/s");
        field.at("slow_to_m_per_s").number(self.slow_to_m_per_s, &slow)?;
        field.at("tolerance_m_per_s").number(self.tolerance_m_per_s, &Limits::above(0.0, 100.0, "m/s"))?;
        field.at("share_aside").number(self.share_aside, &Limits::from(0.0, 1.0, ""))?;
        field.at("speed_m_per_s").number(self.speed_m_per_s, &SPEED)?;
        field.at("slow_within_m").number(self.slow_within_m, &LENGTH).map(drop)
    }

    fn prepared(self, task: &RewardTask) -> Self {
        Self { ways: self.along_shortest_way.then(|| task.ways.clone()), ..self }
    }

    fn ways(&self) -> Option<&Ways> {
        self.ways.as_ref()
    }

    fn along(self, ways: Ways) -> Self {
        Self { ways: self.ways.map(|_| ways), ..self }
    }

    fn looks_along_ways(&self) -> bool {
        self.along_shortest_way
    }

    #[inline(always)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let [speed, within, least, tolerance, aside] = [
            self.speed_m_per_s,
            self.slow_within_m,
            self.slow_to_m_per_s,
            self.tolerance_m_per_s,
            self.share_aside,
        ]
        .map(|value| R::from_f32(value as f32));
        let (goal, place, velocity) = (view.goal, &view.swarm.position, &view.swarm.velocity);
        let square = |i: usize, target: &[Column<LANES, R>; 3], per_second: R| {
            [0, 1, 2].iter().fold(tolerance * tolerance, |sum, axis| {
                let error = velocity[*axis][i] - (target[*axis][i] - place[*axis][i]) * per_second;
                sum + error * error
            })
        };
        let here = R::from_f32(HERE_M);
        let ahead =
            if self.along_shortest_way { view.signposts } else { view.ahead.filter(|_| self.along_own_way) };
        match ahead {
            None => each(values, |i| {
                let distance = view.distances[i];
                let per_second = (speed / distance.at_least(within)).at_least(least / distance.at_least(here));
                worth * (square(i, goal, per_second).sqrt() - tolerance)
            }),
            Some(ahead) => each(values, |i| {
                let [x, y, z] = [0, 1, 2].map(|axis| ahead[axis][i] - place[axis][i]);
                let leg = ((x * x + y * y) + z * z).sqrt().at_least(here);
                let nose = view.swarm.forward(i);
                let share = ((x * nose.x + y * nose.y) / leg).at_least(aside);
                let wanted = view.distances[i].limited(R::zero(), within) * (speed / within) * share;
                let per_second = wanted.at_least(least) / leg;
                worth * (square(i, ahead, per_second).sqrt() - tolerance)
            }),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::HeadingError;
    use super::super::trial::{Trial, assert_near, task};
    use super::*;
    use crate::config::Document;
    use crate::physics::Contacts;

    #[test]
    fn the_wanted_velocity_leads_to_the_goal_and_falls_before_it() {
        // The goal of trials is the origin.
        let mut trial = Trial::of("cruise: { weight: -48, speed_m_per_s: 3, slow_within_m: 1.5 }");
        trial.distance = 5.0;
        for (velocity, error) in [([-2.4, -1.8, 0.0], 0.0_f64), ([0.0; 3], 3.0), ([-2.4, -1.8, 4.0], 4.0)] {
            trial.moving(velocity);
            assert_near(trial.at(4.0, 3.0, 0.0), -((1.0 + error * error).sqrt() - 1.0));
        }
        trial.distance = 0.5;
        trial.moving([-1.0, 0.0, 0.0]);
        assert_near(trial.at(0.5, 0.0, 0.0), 0.0);
        let mut near = Trial::of(
            "cruise: { weight: -48, speed_m_per_s: 3, slow_within_m: 1.5, slow_to_m_per_s: 0.5, tolerance_m_per_s: 0.25 }",
        );
        near.distance = 0.125;
        near.moving([-0.5, 0.0, 0.0]);
        assert_near(near.at(0.125, 0.0, 0.0), 0.0);
        near.moving([-0.5, 0.6, 0.0]);
        assert_near(near.at(0.125, 0.0, 0.0), -(0.65 - 0.25));
    }

    #[test]
    fn it_follows_no_way_where_drones_look_for_none() {
        let document = Document::parse("trial.yaml", "{ along_own_way: true }").unwrap();
        let lost = RewardTask { own_way: false, ..task(Contacts::Absent) };
        let cruise = |along_own_way| Cruise {
            weight: -1.0,
            speed_m_per_s: 1.0,
            slow_within_m: 1.0,
            slow_to_m_per_s: 0.0,
            tolerance_m_per_s: 1.0,
            along_own_way,
            along_shortest_way: false,
            share_aside: 1.0,
            ways: None,
        };
        let refused = |along| cruise(along).check(&lost, &document.root()).map_err(|error| error.to_string());
        let message = refused(true).unwrap_err();
        assert!(
            message.contains("found true for drones that look for no way, expected a sensor `way`"),
            "{message}"
        );
        assert_eq!(refused(false), Ok(()));
        let heading = |heading_deg, task: &RewardTask| {
            let term = HeadingError { weight: -1.0, heading_deg, along_own_way: true };
            term.check(task, &document.root()).is_err()
        };
        let found = task(Contacts::Absent);
        assert_eq!([heading(0.0, &lost), heading(20.0, &found), heading(0.0, &found)], [true, true, false]);
    }

    #[test]
    fn along_a_way_it_leads_to_the_point_ahead_and_slows_down_before_the_goal() {
        let mut trial =
            Trial::of("cruise: { weight: -48, speed_m_per_s: 1, slow_within_m: 0.8, along_own_way: true }");
        trial.ahead = Some([[1.0], [2.3], [0.4]]);
        trial.distance = 3.0;
        trial.moving([0.0, 0.6, 0.8]);
        assert_near(trial.at(1.0, 2.06, 0.08), 0.0);
        trial.distance = 0.4;
        trial.moving([0.0, 0.3, 0.4]);
        assert_near(trial.at(1.0, 2.06, 0.08), 0.0);
        let mut floor = Trial::of(
            "cruise: { weight: -48, speed_m_per_s: 1, slow_within_m: 0.8, slow_to_m_per_s: 0.25, along_own_way: true }",
        );
        (floor.ahead, floor.distance) = (trial.ahead, 0.1);
        floor.moving([0.0, 0.15, 0.2]);
        assert_near(floor.at(1.0, 2.06, 0.08), 0.0);
        let mut aside = Trial::of(
            "cruise: { weight: -48, speed_m_per_s: 1, slow_within_m: 0.8, along_own_way: true, share_aside: 0.3 }",
        );
        // The nose points along +x: ahead of it, 60 degrees and a right angle aside, and straight up.
        (aside.ahead, aside.distance) = (trial.ahead, 3.0);
        let leg = |along: f64, left: f64, up: f64| [1.0 - 0.4 * along, 2.3 - 0.4 * left, 0.4 - 0.4 * up];
        let (cosine, sine) = (0.5, 0.75_f64.sqrt());
        for (direction, speed) in
            [([1.0, 0.0, 0.0], 1.0), ([cosine, sine, 0.0], cosine), ([0.0, 1.0, 0.0], 0.3), ([0.0, 0.0, 1.0], 0.3)]
        {
            let ([along, left, up], velocity) = (direction, direction.map(|part| part * speed));
            aside.moving(velocity);
            let [x, y, z] = leg(along, left, up);
            assert!(aside.at(x, y, z).abs() < 1e-7, "{direction:?}");
        }
        // The point is here: so is the drone to be.
        trial.moving([0.0; 3]);
        assert_near(trial.at(1.0, 2.3, 0.4), 0.0);
    }
}
