//! What the vehicle tells about parameters.

use mavlink::dialects::common::{MavParamError, MavParamType, PARAM_ERROR_DATA, PARAM_VALUE_DATA};

use super::ParameterValue;
use super::received::{ParameterKey, ParameterName};
use super::table::{PARAMETERS, Parameter, ParameterType};
use crate::frame::Payload;

/// The name under which PX4 tells the hash of all parameters.
pub const HASH_NAME: &str = "_HASH_CHECK";

/// Index of what is no parameter of the list.
const NO_INDEX: u16 = u16::MAX;

/// `PARAM_VALUE` of a parameter.
pub fn parameter_value(parameter: Parameter, value: ParameterValue) -> Payload {
    Payload::of(&PARAM_VALUE_DATA {
        param_value: f32::from_le_bytes(value.to_bytes()),
        param_count: PARAMETERS as u16,
        param_index: parameter as u16,
        param_id: parameter.definition().name.into(),
        param_type: match value.kind() {
            ParameterType::Int32 => MavParamType::MAV_PARAM_TYPE_INT32,
            ParameterType::Real32 => MavParamType::MAV_PARAM_TYPE_REAL32,
        },
    })
}

/// `PARAM_VALUE` of the hash of all parameters.
pub fn hash(hash: u32) -> Payload {
    Payload::of(&PARAM_VALUE_DATA {
        param_value: f32::from_bits(hash),
        param_count: PARAMETERS as u16,
        param_index: NO_INDEX,
        param_id: HASH_NAME.into(),
        param_type: MavParamType::MAV_PARAM_TYPE_UINT32,
    })
}

/// `PARAM_ERROR` to the system and component that asked.
pub fn parameter_error(key: &ParameterKey, error: MavParamError, [system, component]: [u8; 2]) -> Payload {
    let (param_index, ParameterName(name)) = match key {
        ParameterKey::Index(index) => (*index as i16, ParameterName::from("")),
        ParameterKey::Name(name) => (-1, *name),
    };
    Payload::of(&PARAM_ERROR_DATA {
        param_index,
        target_system: system,
        target_component: component,
        param_id: name.into(),
        error,
    })
}
