use crate::term::prelude::*;

/// The drone touches a solid, the floor or another drone.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Collision;

impl Rule for Collision {
    fn ending(&self) -> Ending {
        Ending::Collision
    }

    fn start_limit(&self) -> StartLimit {
        StartLimit::Touching
    }

    fn contacts(&self) -> Option<Contacts> {
        Some(Contacts::Reported)
    }

    #[inline(always)]
    fn mark<const LANES: usize, R: Real>(
        &self,
        view: &FlightView<'_, LANES, R>,
        _: &mut [Column<LANES, R>],
        code: f32,
        codes: &mut Column<LANES>,
    ) {
        let half = R::from_f64(0.5);
        mark(codes, code, |lane| view.touches[0][lane] < half);
    }
}
