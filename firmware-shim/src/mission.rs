//! Plans of a vehicle: missions, fences and rally points, and MAVLink's protocol around them.
//!
//! [`received`] and [`sent`] know the messages; [`protocol`] uploads, keeps and downloads the [`MissionItem`]s of a plan. When
//! a plan is whole, the items of a mission have become checked [`step`]s, which a [`runner`] executes, and those of a
//! [`fence`] zones.

pub mod fence;
pub mod place;
pub mod protocol;
pub mod received;
pub mod runner;
pub mod sent;
pub mod step;

pub use protocol::{MissionEvent, MissionProtocol};
pub use received::request;
pub use runner::MissionRunner;

/// Items of a mission.
pub const MISSION_ITEMS: usize = 64;

/// Items of a fence: vertices of its polygons, and circles.
pub const FENCE_ITEMS: usize = kestrel_onboard::fence::ZONES;

/// Rally points.
pub const RALLY_ITEMS: usize = 8;

/// `MAV_MISSION_TYPE`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PlanKind {
    /// What to fly.
    Mission = 0,
    /// Where to fly.
    Fence = 1,
    /// Where to land instead of home.
    Rally = 2,
}

impl PlanKind {
    /// All of them.
    pub const ALL: [Self; 3] = [Self::Mission, Self::Fence, Self::Rally];

    /// Of the number in messages.
    pub fn numbered(number: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|plan| *plan as u8 == number)
    }

    /// Items that it may have.
    pub const fn capacity(self) -> usize {
        match self {
            Self::Mission => MISSION_ITEMS,
            Self::Fence => FENCE_ITEMS,
            Self::Rally => RALLY_ITEMS,
        }
    }
}

/// One item of a plan as it was uploaded, to be downloaded again.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MissionItem {
    /// `MAV_FRAME`.
    pub frame: u8,
    /// `MAV_CMD`.
    pub command: u16,
    /// Zero if the mission shall pause after this item.
    pub autocontinue: u8,
    /// Parameters 1 to 4; NaN where the choice is the vehicle's.
    pub parameters: [f32; 4],
    /// Parameters 5 and 6 \[10⁻⁷ ° or 10⁻⁴ m\]; [`OPEN`] where the choice is the vehicle's.
    pub place: [i32; 2],
    /// Parameter 7 \[m\]; NaN where the choice is the vehicle's.
    pub height: f32,
}

/// A coordinate that is the vehicle's choice.
pub const OPEN: i32 = i32::MAX;

/// Bytes of an item in `MISSION_ITEM_INT`.
pub(crate) const ITEM_LEN: usize = 38;

impl MissionItem {
    /// The fields of `MISSION_ITEM_INT`; the sequence, the addressee, the plan and whether it is the current item are
    /// zero.
    pub(crate) fn fields(&self) -> [u8; ITEM_LEN] {
        let mut fields = [0; ITEM_LEN];
        let [first, second, third, fourth] = self.parameters.map(f32::to_le_bytes);
        let [x, y] = self.place.map(i32::to_le_bytes);
        let words = [first, second, third, fourth, x, y, self.height.to_le_bytes()];
        fields[..28].copy_from_slice(words.as_flattened());
        fields[30..32].copy_from_slice(&self.command.to_le_bytes());
        (fields[34], fields[36]) = (self.frame, self.autocontinue);
        fields
    }
}
