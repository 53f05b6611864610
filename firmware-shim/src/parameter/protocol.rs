//! The parameter protocol, the vehicle's side.

use mavlink::dialects::common::MavParamError;

use super::received::{ParameterKey, ParameterName, ParameterRequest};
use super::sent::{self, HASH_NAME};
use super::table::{PARAMETERS, Parameter, ParameterType};
use super::{ParameterRefusal, ParameterValue, Parameters};
use crate::frame::Payload;
use crate::settings::AutopilotSettings;

/// Values of a list that leave with one tick: 200 in a second of ticks of 10 ms, a twentieth of a 1 Mbit/s radio.
const VALUES_PER_TICK: usize = 2;

/// Polynomial of the hash: CRC-32 of IEEE 802.3, reflected.
const POLYNOMIAL: u32 = 0xEDB8_8320;

/// Parameters that peers list, read and set.
#[derive(Clone, Debug)]
pub struct ParameterProtocol {
    parameters: Parameters,
    /// The next one of a list.
    next: usize,
    /// How many more are to be told. A list asked for while one is told goes on from there and comes round, so that
    /// no flood of requests keeps the end of the list from anybody.
    left: usize,
}

impl ParameterProtocol {
    /// Around these values.
    pub fn new(parameters: Parameters) -> Self {
        Self { parameters, next: 0, left: 0 }
    }

    /// The values.
    pub fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    /// What they mean.
    pub fn settings(&self) -> AutopilotSettings {
        self.parameters.settings()
    }

    /// Answers a request of `sender` (system, component), whose addressee has been checked. The parameter that has a
    /// new value, if one has: the settings are to be looked at again.
    pub fn handle(
        &mut self,
        request: &ParameterRequest,
        sender: [u8; 2],
        send: &mut dyn FnMut(Payload),
    ) -> Option<Parameter> {
        match request {
            ParameterRequest::List => self.left = PARAMETERS,
            ParameterRequest::Read(key) => self.read(key, sender, send),
            ParameterRequest::Set { name, kind, bytes } => return self.set(name, (*kind, *bytes), sender, send),
        }
        None
    }

    /// Goes on with a list.
    pub fn tick(&mut self, send: &mut dyn FnMut(Payload)) {
        for _ in 0..VALUES_PER_TICK.min(self.left) {
            if let Some(parameter) = Parameter::at(self.next) {
                self.publish(parameter, send);
            }
            self.next = (self.next + 1) % PARAMETERS;
            self.left -= 1;
        }
    }

    fn publish(&self, parameter: Parameter, send: &mut dyn FnMut(Payload)) {
        send(sent::parameter_value(parameter, self.parameters.get(parameter)));
    }

    fn read(&self, key: &ParameterKey, sender: [u8; 2], send: &mut dyn FnMut(Payload)) {
        let parameter = match key {
            ParameterKey::Name(name) if name.text() == HASH_NAME => return send(sent::hash(self.hash())),
            ParameterKey::Name(name) => Parameter::named(name.text()),
            ParameterKey::Index(index) => Parameter::at((*index).into()),
        };
        match parameter {
            Some(parameter) => self.publish(parameter, send),
            None => send(sent::parameter_error(key, MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST, sender)),
        }
    }

    /// Sets a parameter to a value of a type in bytes, and tells the value it then has, new or old.
    fn set(
        &mut self,
        name: &ParameterName,
        (kind, bytes): (u8, [u8; 4]),
        sender: [u8; 2],
        send: &mut dyn FnMut(Payload),
    ) -> Option<Parameter> {
        let refusal = |error| sent::parameter_error(&ParameterKey::Name(*name), error, sender);
        if name.text() == HASH_NAME {
            // QGroundControl sends PX4's hash back when it has the list already.
            self.left = 0;
            return None;
        }
        let Some(parameter) = Parameter::named(name.text()) else {
            send(refusal(MavParamError::MAV_PARAM_ERROR_DOES_NOT_EXIST));
            return None;
        };
        let before = self.parameters.get(parameter);
        let outcome = match ParameterType::numbered(kind) {
            None => Err(MavParamError::MAV_PARAM_ERROR_TYPE_UNSUPPORTED),
            Some(kind) => self
                .parameters
                .set(parameter, ParameterValue::from_bytes(kind, bytes))
                .map_err(ParameterRefusal::error),
        };
        if let Err(error) = outcome {
            send(refusal(error));
        }
        self.publish(parameter, send);
        (self.parameters.get(parameter) != before).then_some(parameter)
    }

    /// What PX4 computes over names and values in their order, for ground stations that keep a copy: a CRC-32 that
    /// begins and ends without inversion.
    fn hash(&self) -> u32 {
        Parameter::ALL.into_iter().fold(0, |hash, parameter| {
            let hash = checksum(hash, parameter.definition().name.as_bytes());
            checksum(hash, &self.parameters.get(parameter).to_bytes())
        })
    }
}

/// CRC-32 without inversion at its beginning and end, of bytes after others whose own was `start`, 0 after none.
pub(crate) fn checksum(start: u32, bytes: &[u8]) -> u32 {
    bytes.iter().fold(start, |sum, byte| {
        (0..8).fold(sum ^ u32::from(*byte), |sum, _| (sum >> 1) ^ (POLYNOMIAL * (sum & 1)))
    })
}

impl ParameterRefusal {
    fn error(self) -> MavParamError {
        match self {
            Self::ReadOnly { .. } => MavParamError::MAV_PARAM_ERROR_READ_ONLY,
            Self::Type { .. } => MavParamError::MAV_PARAM_ERROR_TYPE_MISMATCH,
            Self::Range { .. } => MavParamError::MAV_PARAM_ERROR_VALUE_OUT_OF_RANGE,
        }
    }
}

#[cfg(test)]
mod tests;
