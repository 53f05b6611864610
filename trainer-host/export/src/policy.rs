//! A policy file of any kind.

use kestrel_core::action::ActionSpace;
use kestrel_core::gru::HiddenState;
use kestrel_core::observation::ObservationLayout;
use kestrel_core::policy_file::{
    Arithmetic, PolicyError, PolicyFile, PolicyMetadata, PolicyScratch, RecurrentPolicy, VisionPolicy,
};
use kestrel_sim::camera::OnboardCamera;
use kestrel_sim::scenario::Scenario;

use crate::seeing::Memory;

/// Control periods of a policy and a task may differ by this share: both are written in decimal somewhere.
const PERIOD_TOLERANCE: f32 = 1e-5;

/// A policy whose parameters lie in borrowed bytes.
#[derive(Clone, Debug)]
pub enum Policy<'a> {
    /// A policy without an eye.
    Blind(Box<PolicyFile<'a>>),
    /// A policy with an eye.
    Seeing(Box<VisionPolicy<'a>>),
    /// A policy with a memory.
    Recurrent(Box<RecurrentPolicy<'a>>),
}

/// What two things of a kind are; where they are called the same, their scales differ.
fn between(kind: &str, policy: &str, task: &str) -> String {
    let scales = if policy == task { ", with other scales" } else { "" };
    format!("{kind} (it has {policy}, the task {task}{scales})")
}

impl<'a> Policy<'a> {
    /// The policy in `bytes`, which are the whole file and start on a four-byte boundary of memory.
    ///
    /// # Errors
    /// A variant per kind of damage.
    pub fn parse(bytes: &'a [u8]) -> Result<Self, PolicyError> {
        match PolicyFile::parse(bytes) {
            Ok(policy) => Ok(Self::Blind(Box::new(policy))),
            Err(PolicyError::Vision) => VisionPolicy::parse(bytes).map(|policy| Self::Seeing(Box::new(policy))),
            Err(PolicyError::Recurrent) => {
                RecurrentPolicy::parse(bytes).map(|policy| Self::Recurrent(Box::new(policy)))
            }
            Err(error) => Err(error),
        }
    }

    /// Computes the golden vectors again.
    ///
    /// # Errors
    /// [`PolicyError::SelfTest`] with the first deviation.
    pub fn self_test(&self) -> Result<(), PolicyError> {
        match self {
            Self::Blind(policy) => policy.self_test(),
            Self::Seeing(policy) => {
                let mut memory = Memory::of(policy);
                policy.self_test_with(&mut memory.borrowed(), &mut PolicyScratch::new())
            }
            Self::Recurrent(policy) => policy.self_test_with(&mut HiddenState::new(), &mut PolicyScratch::new()),
        }
    }

    /// Name, observation layout, action space, control period.
    pub fn metadata(&self) -> &PolicyMetadata<'a> {
        match self {
            Self::Blind(policy) => policy.metadata(),
            Self::Seeing(policy) => policy.metadata(),
            Self::Recurrent(policy) => policy.metadata(),
        }
    }

    /// What it is computed with.
    pub fn arithmetic(&self) -> Arithmetic {
        match self {
            Self::Blind(policy) => policy.arithmetic(),
            Self::Seeing(policy) => policy.arithmetic(),
            Self::Recurrent(policy) => policy.arithmetic(),
        }
    }

    /// In what it differs from a policy that was trained for a scenario: `observation (has body of 29 values, the task …)`.
    pub fn differing(&self, scenario: &Scenario) -> Option<String> {
        let metadata = self.metadata();
        let (observation, action) = (&metadata.observation, &metadata.action.on(&scenario.airframe));
        let period_secs = scenario.physics.control_secs();
        if *observation != scenario.observation {
            let words = |layout: &ObservationLayout| format!("`{}` of {} values", layout.name(), layout.len());
            Some(between("observation", &words(observation), &words(&scenario.observation)))
        } else if *action != scenario.action {
            let words = |space: &ActionSpace| format!("`{}` of {} values", space.name(), space.len());
            Some(between("action", &words(action), &words(&scenario.action)))
        } else if metadata.control_period_secs != period_secs {
            let words = |secs: f32| format!("{secs} s");
            Some(between("control period", &words(metadata.control_period_secs), &words(period_secs)))
        } else if !self.suits(scenario.camera.as_ref()) {
            Some("camera".to_owned())
        } else {
            None
        }
    }

    /// Whether it flies to a point that anybody may choose: it sees its goal, and nothing that only its task has.
    pub fn flies_anywhere(&self) -> bool {
        let layout = &self.metadata().observation;
        !matches!(self, Self::Seeing(_)) && layout.shows_goal() && layout.measured_len() == 0
    }

    /// Whether it acts once in a control period of so many seconds, as near as decimal numbers say.
    pub fn keeps_pace(&self, control_secs: f32) -> bool {
        (self.metadata().control_period_secs - control_secs).abs() <= PERIOD_TOLERANCE * control_secs
    }

    /// Whether the images of a camera are what it looks at.
    fn suits(&self, camera: Option<&OnboardCamera>) -> bool {
        match (self, camera) {
            (Self::Blind(_) | Self::Recurrent(_), None) => true,
            (Self::Seeing(policy), Some(camera)) => {
                let image = policy.encoder().shape().image();
                let found = [image.rows, image.columns, image.channels].map(usize::from);
                found == [camera.camera.rows, camera.camera.columns, camera.pixel_len()]
                    && u32::from(policy.control_periods_per_image()) == camera.control_periods_per_image
            }
            (Self::Blind(_) | Self::Recurrent(_), Some(_)) | (Self::Seeing(_), None) => false,
        }
    }
}
