//! What ground stations ask for and a vehicle in simulation has not: they are told so, instead of waiting.

use kestrel_onboard::request::Address;

use super::Vehicle;
use crate::frame::{Frame, Payload};
use crate::geodesy::Home;
use crate::policy_backend::PolicyBackend;

/// `SET_GPS_GLOBAL_ORIGIN` and `LOG_REQUEST_LIST`.
const SET_ORIGIN: u32 = 48;
const LOG_LIST: u32 = 117;

impl<P: PolicyBackend> Vehicle<P> {
    /// Answers a request that is not followed, if it is a known one to this vehicle.
    pub(super) fn decline(&mut self, frame: &Frame) {
        let [system, component] = match frame.message_id {
            SET_ORIGIN => [frame.fields::<13>()[12], 0],
            LOG_LIST => frame.fields::<6>()[4..].try_into().unwrap_or_default(),
            _ => return,
        };
        if !self.controller.is_meant(Address { system, component }) {
            return;
        }
        if frame.message_id == SET_ORIGIN {
            self.controller.answer(global_origin(&self.profile.origin));
            self.send_status_text(Some("origin refused: it is that of --home"));
        } else {
            self.controller.answer(no_logs());
        }
    }
}

/// `GPS_GLOBAL_ORIGIN`: where the world's origin lies.
fn global_origin(origin: &Home) -> Payload {
    let place = origin.place_of(&nalgebra::Vector3::zeros());
    let [latitude, longitude] = place.integers();
    let height_mm = libm::round(place.altitude_m * 1e3) as i32;
    let mut fields = [0; 12];
    for (field, number) in fields.chunks_exact_mut(4).zip([latitude, longitude, height_mm]) {
        field.copy_from_slice(&number.to_le_bytes());
    }
    Payload::new(49, 39, &fields)
}

/// `LOG_ENTRY` that says that there are none.
fn no_logs() -> Payload {
    Payload::new(118, 56, &[0; 14])
}
