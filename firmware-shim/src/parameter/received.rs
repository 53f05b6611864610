//! What peers ask about parameters, read field by field.

use super::table::NAME_LEN;
use crate::frame::Frame;
use crate::request::Address;

/// The index that leaves it to the name.
const BY_NAME: i16 = -1;

/// A request of the parameter protocol.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterRequest {
    /// `PARAM_REQUEST_LIST`: tell all of them.
    List,
    /// `PARAM_REQUEST_READ`: tell one.
    Read(ParameterKey),
    /// `PARAM_SET`.
    Set {
        /// Of the parameter.
        name: ParameterName,
        /// `MAV_PARAM_TYPE` of the value.
        kind: u8,
        /// The value, bytewise.
        bytes: [u8; 4],
    },
}

/// What tells one parameter from the others.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ParameterKey {
    /// Its index; negative ones have become greater than any.
    Index(u16),
    /// Its name.
    Name(ParameterName),
}

/// A name in a message: up to 16 bytes, ended by a zero if shorter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct ParameterName(pub [u8; NAME_LEN]);

impl ParameterName {
    /// Its text, empty if that is no UTF-8.
    pub fn text(&self) -> &str {
        let len = self.0.iter().position(|byte| *byte == 0).unwrap_or(NAME_LEN);
        core::str::from_utf8(&self.0[..len]).unwrap_or_default()
    }
}

impl From<&str> for ParameterName {
    /// Of the first 16 bytes of a text.
    fn from(text: &str) -> Self {
        let mut name = [0; NAME_LEN];
        name.iter_mut().zip(text.bytes()).for_each(|(to, from)| *to = from);
        Self(name)
    }
}

/// The request in a frame and its addressee; none if the message is none of this protocol.
pub fn request(frame: &Frame) -> Option<(Address, ParameterRequest)> {
    match frame.message_id {
        20 => Some(read(&frame.fields())),
        21 => {
            let [system, component] = frame.fields();
            Some((Address { system, component }, ParameterRequest::List))
        }
        23 => Some(set(&frame.fields())),
        _ => None,
    }
}

fn read(fields: &[u8; 20]) -> (Address, ParameterRequest) {
    let key = match i16::from_le_bytes([fields[0], fields[1]]) {
        BY_NAME => ParameterKey::Name(name_at(fields, 4)),
        index => ParameterKey::Index(index as u16),
    };
    (Address { system: fields[2], component: fields[3] }, ParameterRequest::Read(key))
}

fn set(fields: &[u8; 23]) -> (Address, ParameterRequest) {
    let bytes = [fields[0], fields[1], fields[2], fields[3]];
    let request = ParameterRequest::Set { name: name_at(fields, 6), kind: fields[22], bytes };
    (Address { system: fields[4], component: fields[5] }, request)
}

fn name_at(fields: &[u8], at: usize) -> ParameterName {
    ParameterName(core::array::from_fn(|i| fields[at + i]))
}

#[cfg(test)]
mod tests {
    use mavlink::dialects::common::{
        MavParamType, PARAM_REQUEST_LIST_DATA, PARAM_REQUEST_READ_DATA, PARAM_SET_DATA,
    };

    use super::*;
    use crate::frame::{Encoder, Frames, Payload};

    const TARGET: Address = Address { system: 8, component: 9 };

    fn asked<D: mavlink::MessageData>(message: &D) -> (Address, ParameterRequest) {
        let bytes = Encoder::new(255, 190).encode(&Payload::of(message));
        request(&Frames::new(&bytes).next().unwrap().unwrap()).unwrap()
    }

    fn asked_for(param_index: i16, name: &str) -> ParameterRequest {
        let message =
            PARAM_REQUEST_READ_DATA { param_index, target_system: 8, target_component: 9, param_id: name.into() };
        let (address, request) = asked(&message);
        assert_eq!(address, TARGET);
        request
    }

    #[test]
    fn requests_are_read_as_the_mavlink_crate_writes_them() {
        let list = PARAM_REQUEST_LIST_DATA { target_system: 8, target_component: 9 };
        assert_eq!(asked(&list), (TARGET, ParameterRequest::List));
        assert_eq!(asked_for(3, "X"), ParameterRequest::Read(ParameterKey::Index(3)));
        assert_eq!(
            asked_for(-1, "COM_DL_LOSS_T"),
            ParameterRequest::Read(ParameterKey::Name("COM_DL_LOSS_T".into()))
        );
        assert_eq!(asked_for(-2, "X"), ParameterRequest::Read(ParameterKey::Index(65534)));
        let set = PARAM_SET_DATA {
            param_value: f32::from_bits(5),
            target_system: 8,
            target_component: 9,
            param_id: "SIXTEEN_LETTERS_".into(),
            param_type: MavParamType::MAV_PARAM_TYPE_INT32,
        };
        let expected = ParameterRequest::Set { name: "SIXTEEN_LETTERS_".into(), kind: 6, bytes: [5, 0, 0, 0] };
        assert_eq!(asked(&set), (TARGET, expected));
    }

    #[test]
    fn names_end_at_a_zero_or_after_sixteen_bytes() {
        assert_eq!(ParameterName::from("GF_ACTION").text(), "GF_ACTION");
        assert_eq!(ParameterName::from("SIXTEEN_LETTERS_AND_MORE").text(), "SIXTEEN_LETTERS_");
        assert_eq!(ParameterName([0xff; NAME_LEN]).text(), "");
        assert_eq!(ParameterName([0; NAME_LEN]).text(), "");
    }
}
