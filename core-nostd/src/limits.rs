//! The sizes that networks, observations and actions share.

/// Values of an action in every space of ours.
pub const ACTION_LEN: usize = 4;

/// Most values in an action; what is beyond a space's own is not read.
pub const ACTION_LIMIT: usize = 6;

/// Most layers of a policy.
pub const LAYER_LIMIT: usize = 4;

/// Most values in an observation or a hidden layer.
pub const WIDTH_LIMIT: usize = 128;

/// Most values in an observation: as many as a policy reads.
pub const OBSERVATION_LIMIT: usize = WIDTH_LIMIT;

/// Most past actions that an observation layout reads.
pub const HISTORY_LIMIT: usize = 32;

#[cfg(feature = "recurrent")]
/// Most units of a recurrent policy's memory; their gates are the outputs of one layer.
pub const UNITS_LIMIT: usize = WIDTH_LIMIT / 2;

/// Rows of a stored layer are filled up to a multiple of this.
pub(crate) const ROW_BLOCK: usize = 4;
