use crate::term::prelude::*;

/// Free space around the drone's centre, as a share of `reach_m`: 1 where nothing that never moves is nearer than that, 0
/// where its surface is. The distance is looked up in the map that finds contacts, a few centimetres too short.
#[derive(Clone, Debug, PartialEq, Deserialize, Serialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(inline)]
pub struct Clearance {
    /// What one unit is worth.
    pub weight: f64,
    /// Distance from which it is one.
    pub reach_m: f64,
}

/// Farther away the map is coarse.
const REACH: Limits = Limits::above(0.0, 0.5, "m");

impl Term for Clearance {
    const PAID: Paid = Paid::PerSecond;

    fn check(&self, task: &RewardTask, field: &Field<'_>) -> Result<(), ConfigError> {
        field.at("reach_m").number(self.reach_m, &REACH)?;
        task.needs_contacts("clearance", field)
    }

    #[inline(never)]
    fn evaluate<const LANES: usize, R: Real>(
        &self,
        view: &StepView<'_, LANES, R>,
        worth: R,
        _: &mut [Column<LANES, R>],
        values: &mut Column<LANES, R>,
    ) {
        let Some(arenas) = view.arenas else {
            values.fill(worth);
            return;
        };
        let free =
            arenas.clearances(view.rooms, &view.swarm.position.each_ref().map(|axis| axis.map(Real::to_f32)));
        let share = |lane: usize| R::from_f32(free[lane] / self.reach_m as f32);
        each(values, |i| worth * share(i).limited(R::zero(), R::one()));
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use kestrel_core::airframe::CF2X;

    use super::super::trial::{Trial, assert_all_near, assert_near, task};
    use super::*;
    use crate::config::Document;
    use crate::contact::{Arena, ContactReport};
    use crate::rooms::Arenas;
    use crate::world::{Floor, Solid, World};

    #[test]
    fn the_nearest_thing_counts_and_only_within_reach() {
        let wall = Solid::block("wall", Vector3::new(1.0, -2.0, 0.0), Vector3::new(1.2, 2.0, 3.0));
        let world = World { floor: Floor::Solid, solids: vec![wall], ..World::empty() };
        let mut trial = Trial::of("clearance: { weight: 48, reach_m: 0.4 }");
        trial.arenas = Some(Arenas::Same(Arc::new(Arena::new(&world, &CF2X, ContactReport::Touch))));
        assert_all_near(
            &trial.along(&[[-3.0, 0.0, 1.0], [-3.0, 0.0, 0.25], [-3.0, 0.0, -0.1]]),
            &[1.0, 0.625, 0.0],
        );
        let beside = trial.at(0.8, 0.0, 1.5);
        assert!(beside <= 0.5 && beside > 0.25, "{beside}");
        assert_near(trial.at(1.1, 0.0, 1.5), 0.0);
    }

    #[test]
    fn it_takes_contacts() {
        let document = Document::parse("trial.yaml", "{ weight: 1, reach_m: 0.4 }").unwrap();
        let refused =
            |contacts| Clearance { weight: 1.0, reach_m: 0.4 }.check(&task(contacts), &document.root()).is_err();
        let all = [Contacts::Absent, Contacts::Reported, Contacts::Solved];
        assert_eq!(all.map(refused), [true, false, false]);
    }
}
