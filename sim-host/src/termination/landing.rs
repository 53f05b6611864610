use crate::term::prelude::*;

/// The drone touches the landing zone: success (`TouchLandingZoneTerm`).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Landing;

impl Rule for Landing {
    fn ending(&self) -> Ending {
        Ending::Success
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
        mark(codes, code, |lane| view.touches[1][lane] < half);
    }
}
