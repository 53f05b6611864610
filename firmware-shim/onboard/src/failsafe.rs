//! What can go wrong in flight, and when it counts as having gone wrong.
//!
//! A condition that lasts for its time becomes an event, once; it can become one again after it was gone. What is done then is
//! the autopilot's business, by its [`AutopilotSettings`].

use kestrel_core::vehicle::State;

use crate::settings::{AutopilotSettings, FailsafeAction, FailsafeReaction};

/// What has gone wrong.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FailsafeEvent {
    /// No set-point for too long: the offboard mode is left.
    OffboardLost,
    /// No word from the ground station for too long.
    LinkLost,
    /// The drone is outside the fence.
    FenceLeft,
    /// The battery is low.
    BatteryLow,
    /// It is critical.
    BatteryCritical,
    /// It is nearly empty.
    BatteryEmpty,
    /// Tilted too far for too long.
    Tilted,
    /// Turning too fast for too long.
    Spinning,
    /// The policy gave no answer, or none that is finite, for too long.
    PolicySilent,
    /// The policy kept a rotor at its limits for too long.
    PolicySaturated,
    /// At this speed the drone soon touches what its rangers see.
    CollisionCourse,
}

/// What events are made of, in one control period.
#[derive(Clone, Copy, Debug)]
pub struct FailsafeInput<'a> {
    /// Finite.
    pub state: &'a State<f32>,
    /// Since the last set-point, in the offboard mode \[s\].
    pub set_point_age_secs: Option<f32>,
    /// Since the last word of a ground station, if there was any \[s\].
    pub link_age_secs: Option<f32>,
    /// Distance to the fence from within, negative outside \[m\].
    pub fence_margin_m: f32,
    /// What is left of the battery, of one.
    pub battery: f32,
    /// How long the policy has not answered \[s\].
    pub silent_secs: f32,
    /// How long it has kept a rotor at its limits \[s\].
    pub saturated_secs: f32,
    /// Time until the drone is at what its rangers see, if that is known and nears \[s\].
    pub collision_secs: Option<f32>,
}

/// Watches for all events.
#[derive(Clone, Debug, Default)]
pub struct Failsafe {
    present: [bool; FailsafeEvent::ALL.len()],
    tilted_secs: f32,
    spinning_secs: f32,
}

impl FailsafeEvent {
    /// All of them, the hardest to fly with last.
    pub const ALL: [Self; 11] = [
        Self::OffboardLost,
        Self::LinkLost,
        Self::FenceLeft,
        Self::BatteryLow,
        Self::BatteryCritical,
        Self::BatteryEmpty,
        Self::CollisionCourse,
        Self::PolicySaturated,
        Self::PolicySilent,
        Self::Tilted,
        Self::Spinning,
    ];

    /// What is done about it.
    pub fn reaction(self, settings: &AutopilotSettings) -> FailsafeReaction {
        let [low, critical, empty] = settings.battery_actions;
        match self {
            Self::OffboardLost => FailsafeReaction::only(settings.offboard_loss_action),
            Self::LinkLost => FailsafeReaction::only(settings.link_loss_action),
            Self::FenceLeft => FailsafeReaction::only(settings.fence_action),
            Self::BatteryLow => FailsafeReaction::only(low),
            Self::BatteryCritical => FailsafeReaction::only(critical),
            Self::BatteryEmpty => FailsafeReaction::only(empty),
            Self::Tilted | Self::Spinning => settings.upset_reaction,
            Self::PolicySilent | Self::PolicySaturated => settings.policy_reaction,
            Self::CollisionCourse => FailsafeReaction::with_cascade(FailsafeAction::Hold),
        }
    }

    /// At most the 50 bytes of a `STATUSTEXT`.
    pub const fn text(self) -> &'static str {
        match self {
            Self::OffboardLost => "failsafe: no set-points",
            Self::LinkLost => "failsafe: ground station lost",
            Self::FenceLeft => "failsafe: outside the fence",
            Self::BatteryLow => "failsafe: battery low",
            Self::BatteryCritical => "failsafe: battery critical",
            Self::BatteryEmpty => "failsafe: battery nearly empty",
            Self::Tilted => "failsafe: tilted too far",
            Self::Spinning => "failsafe: turning too fast",
            Self::PolicySilent => "failsafe: policy gives no answer",
            Self::PolicySaturated => "failsafe: policy keeps a motor at its limit",
            Self::CollisionCourse => "failsafe: on a collision course",
        }
    }
}

impl Failsafe {
    /// Forgets what it saw, as before a flight.
    pub fn reset(&mut self) {
        *self = Self::default();
    }

    /// The events that begin in a control period of `secs`.
    pub fn watch(
        &mut self,
        situation: &FailsafeInput,
        settings: &AutopilotSettings,
        secs: f32,
    ) -> heapless::Vec<FailsafeEvent, { FailsafeEvent::ALL.len() }> {
        self.count(situation.state, settings, secs);
        let before = self.present;
        self.present = FailsafeEvent::ALL.map(|event| self.is_present(event, situation, settings));
        let mut begun = heapless::Vec::new();
        for ((event, present), before) in FailsafeEvent::ALL.iter().zip(&self.present).zip(&before) {
            if *present && !before {
                // There is room for each of them once.
                let _ = begun.push(*event);
            }
        }
        begun
    }

    fn count(&mut self, state: &State<f32>, settings: &AutopilotSettings, secs: f32) {
        let after = |before: f32, exceeds| if exceeds { before + secs } else { 0.0 };
        let tilted = state.world_from_body.up_cosine() < libm::cosf(settings.tilt_limit_rad);
        let spinning = state.body_rates.amax() > settings.rate_limit;
        self.tilted_secs = after(self.tilted_secs, tilted);
        self.spinning_secs = after(self.spinning_secs, spinning);
    }

    fn is_present(&self, event: FailsafeEvent, situation: &FailsafeInput, settings: &AutopilotSettings) -> bool {
        let [low, critical, empty] = settings.battery_levels;
        let older = |age_secs: Option<f32>, limit_secs| age_secs.is_some_and(|age_secs| age_secs > limit_secs);
        match event {
            FailsafeEvent::OffboardLost => older(situation.set_point_age_secs, settings.offboard_loss_secs),
            FailsafeEvent::LinkLost => older(situation.link_age_secs, settings.link_loss_secs),
            FailsafeEvent::FenceLeft => situation.fence_margin_m < 0.0,
            FailsafeEvent::BatteryLow => situation.battery <= low,
            FailsafeEvent::BatteryCritical => situation.battery <= critical,
            FailsafeEvent::BatteryEmpty => situation.battery <= empty,
            FailsafeEvent::Tilted => self.tilted_secs > settings.tilt_secs,
            FailsafeEvent::Spinning => self.spinning_secs > settings.rate_secs,
            FailsafeEvent::PolicySilent => situation.silent_secs > settings.silence_secs,
            FailsafeEvent::PolicySaturated => situation.saturated_secs > settings.saturation_secs,
            FailsafeEvent::CollisionCourse => settings
                .clearance_secs
                .zip(situation.collision_secs)
                .is_some_and(|(clearance_secs, collision_secs)| collision_secs < clearance_secs),
        }
    }
}

#[cfg(test)]
mod tests {
    use kestrel_core::airframe::CF2X;
    use kestrel_core::attitude::Attitude;
    use nalgebra::Vector3;

    use super::*;
    use crate::plant::{FlatFloor, Plant};

    const CONTROL_SECS: f32 = 0.01;

    fn level() -> State<f32> {
        *FlatFloor::new(&CF2X, CONTROL_SECS).state()
    }

    /// What begins in one control period.
    fn begun(failsafe: &mut Failsafe, state: &State<f32>, battery: f32) -> Vec<FailsafeEvent> {
        let input = FailsafeInput {
            state,
            set_point_age_secs: None,
            link_age_secs: None,
            fence_margin_m: 1.0,
            battery,
            silent_secs: 0.0,
            saturated_secs: 0.0,
            collision_secs: None,
        };
        failsafe.watch(&input, &AutopilotSettings::default(), CONTROL_SECS).to_vec()
    }

    #[test]
    fn tilts_and_spins_that_are_too_short_do_not_add_up() {
        let overturned = Attitude { w: 0.0, x: 1.0, y: 0.0, z: 0.0 };
        let upset = State { world_from_body: overturned, body_rates: Vector3::new(0.0, 0.0, -20.0), ..level() };
        let mut failsafe = Failsafe::default();
        for _ in 0..5 {
            for _ in 0..29 {
                assert_eq!(begun(&mut failsafe, &upset, 1.0), []);
            }
            assert_eq!(begun(&mut failsafe, &level(), 1.0), []);
        }
        let events: Vec<_> = (0..40).flat_map(|_| begun(&mut failsafe, &upset, 1.0)).collect();
        assert_eq!(events, [FailsafeEvent::Tilted, FailsafeEvent::Spinning], "once each");
    }

    #[test]
    fn a_level_of_the_battery_is_reached_when_it_is_just_as_low() {
        let [low, critical, empty] = AutopilotSettings::default().battery_levels;
        let mut failsafe = Failsafe::default();
        for (level_share, event) in [
            (low, FailsafeEvent::BatteryLow),
            (critical, FailsafeEvent::BatteryCritical),
            (empty, FailsafeEvent::BatteryEmpty),
        ] {
            assert_eq!(begun(&mut failsafe, &level(), level_share + 1e-6), []);
            assert_eq!(begun(&mut failsafe, &level(), level_share), [event]);
            assert_eq!(begun(&mut failsafe, &level(), level_share), [], "once");
        }
    }
}
