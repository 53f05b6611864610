//! What of a body matters in a tile.

use super::{Plane, Side};

/// What of a body the eye sees, and through what.
#[derive(Clone, Copy)]
pub(super) struct Outline<'a> {
    /// Planes that face the eye.
    pub(super) entered: &'a [Plane],
    /// Planes that do not.
    pub(super) left: &'a [Plane],
    pub(super) side: Option<&'a Side>,
    /// Greatest inverse depth that is seen \[1/m\].
    pub(super) limit: f32,
}

impl<'a> Outline<'a> {
    /// The planes that make a difference in a tile; nothing if the body is not in it, or hidden. `kept` has room for all
    /// planes and one more.
    #[inline(always)]
    pub(super) fn in_tile(&self, place: [f32; 2], farthest: f32, kept: &'a mut [Plane]) -> Option<Self> {
        // Bounds of where rays enter, and where at the latest they leave.
        let (mut enter, mut leave) = ([f32::INFINITY; 2], 0.0_f32);
        for plane in self.entered {
            let [low, high] = plane.inverse.range(place);
            enter = [least(low, enter[0]), least(high, enter[1])];
        }
        for plane in self.left {
            leave = greatest(plane.inverse.range(place)[0], leave);
        }
        if enter[1] <= farthest || enter[1] < leave {
            return None;
        }
        let mut count = 0;
        for plane in self.entered {
            kept[count] = *plane;
            count += usize::from(plane.inverse.range(place)[0] <= enter[1]);
        }
        let entered = count;
        if self.side.is_none() {
            leave = greatest(enter[0], leave);
        }
        for plane in self.left {
            kept[count] = *plane;
            count += usize::from(plane.inverse.range(place)[1] >= leave);
        }
        let (entered, left) = kept[..count].split_at(entered);
        Some(Self { entered, left, ..*self })
    }
}

/// The lesser, and the other one where the first is NaN: one instruction, where [`f32::min`] takes four.
#[inline(always)]
fn least(one: f32, other: f32) -> f32 {
    if one < other { one } else { other }
}

/// The greater, and the other one where the first is NaN.
#[inline(always)]
fn greatest(one: f32, other: f32) -> f32 {
    if one > other { one } else { other }
}
