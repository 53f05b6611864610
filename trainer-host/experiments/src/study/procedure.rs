//! How a method learns several tasks.

use kestrel_learn::ppo::CarryOver;
use kestrel_learn::regulariser::{CoresetSettings, DistillationSettings, RegulariserSettings};

use super::data::MethodKind;
pub use super::sharing::Merge;
use crate::learner::LearnerSettings;

/// Who learns, and how.
#[derive(Clone, Debug, PartialEq)]
pub struct Method {
    /// Short name, which files carry.
    pub name: String,
    /// What the report says about it.
    pub about: String,
    /// How it learns several tasks.
    pub procedure: Procedure,
    /// How each task is trained, if not as the study says.
    pub training: Option<LearnerSettings>,
}

/// How several tasks are learned.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Procedure {
    /// One after the other, by one policy.
    Sequential {
        /// What keeps earlier tasks.
        regulariser: RegulariserSettings,
        /// What a task begins with.
        warm_start_rule: WarmStartRule,
    },
    /// All at once, by one policy.
    Joint,
    /// Each by a policy of its own; the policies are averaged now and then.
    Sharing {
        /// Updates between two averages.
        every_updates: u64,
        /// What is averaged.
        merge: Merge,
    },
    /// Each by a fresh policy that is kept.
    Experts {
        /// Whether each is trained as its own file says, and sees what that says.
        own_training: bool,
    },
    /// One after the other, each by a fresh policy that then teaches the one that is kept.
    Distil {
        /// The states that are kept; their strength is not used.
        coreset: CoresetSettings,
        /// How the policy is taught.
        distillation: DistillationSettings,
    },
}

/// What a task begins with.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct WarmStartRule {
    /// The network for the mean action.
    pub policy: CarryOver,
    /// The standard deviations of the actions.
    pub log_std: CarryOver,
    /// Critic and optimisers.
    pub learner: CarryOver,
}

impl Procedure {
    /// Whether it keeps states, or what follows from them, of a task that has ended: such methods know no images.
    pub fn keeps_states(&self) -> bool {
        match self {
            Self::Sequential { regulariser: RegulariserSettings::None, .. }
            | Self::Joint
            | Self::Sharing { .. }
            | Self::Experts { .. } => false,
            Self::Sequential { .. } | Self::Distil { .. } => true,
        }
    }

    /// Stages in which so many tasks are learned.
    pub fn stages(&self, tasks: usize) -> usize {
        match self {
            Self::Sequential { .. } | Self::Experts { .. } | Self::Distil { .. } => tasks,
            Self::Joint | Self::Sharing { .. } => 1,
        }
    }

    /// In which manner several tasks are learned, for people.
    pub fn manner(&self) -> &'static str {
        match self {
            Self::Sequential { regulariser: RegulariserSettings::None, .. } => "one after the other",
            Self::Sequential { .. } => "one after the other, with a regulariser",
            Self::Joint => "at once",
            Self::Sharing { .. } => "at once, by policies that are averaged",
            Self::Experts { .. } => "each by a policy of its own",
            Self::Distil { .. } => "one after the other, each taught to the policy that is kept",
        }
    }

    /// What its stages are.
    pub fn kind(&self) -> MethodKind {
        match self {
            Self::Sequential { .. } | Self::Distil { .. } => MethodKind::Sequential,
            Self::Joint => MethodKind::Joint,
            Self::Sharing { .. } => MethodKind::Averaged,
            Self::Experts { .. } => MethodKind::Experts,
        }
    }

    /// Whether nobody tells it when a task ends.
    pub fn finds_boundaries(&self) -> bool {
        match self {
            Self::Sequential { regulariser, .. } => regulariser.finds_boundaries(),
            Self::Joint | Self::Sharing { .. } | Self::Experts { .. } | Self::Distil { .. } => false,
        }
    }

    /// Whether each task is trained as its own file says.
    pub fn trains_as_configured(&self) -> bool {
        match self {
            Self::Experts { own_training } => *own_training,
            Self::Sequential { .. } | Self::Joint | Self::Sharing { .. } | Self::Distil { .. } => false,
        }
    }

    /// Whether the order of the tasks makes a difference.
    pub fn knows_order(&self) -> bool {
        self.kind() == MethodKind::Sequential
    }
}
