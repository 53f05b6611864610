//! What the vehicle is and can do.

use mavlink::dialects::common::{
    AUTOPILOT_VERSION_DATA, AVAILABLE_MODES_DATA, AVAILABLE_MODES_MONITOR_DATA, COMPONENT_METADATA_DATA,
    MavModeProperty, MavProtocolCapability, MavStandardMode,
};

use crate::files::metadata::GENERAL_URI;
use crate::flight_mode::FlightMode;
use crate::frame::Payload;
use crate::personality::Personality;
use kestrel_onboard::signature::fingerprint;

/// Bytes of a mode's name.
const MODE_NAME_LIMIT: usize = 35;

/// The policy, as peers are told of it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PolicyIdentity {
    /// Its name, or the beginning of a long one.
    pub name: heapless::String<MODE_NAME_LIMIT>,
    /// The first eight bytes of SHA-256 over its file.
    pub hash: [u8; 8],
}

impl PolicyIdentity {
    /// Of a policy of this name in this file.
    pub fn of(name: &str, file: &[u8]) -> Self {
        let mut own = heapless::String::new();
        for letter in name.chars() {
            if own.push(letter).is_err() {
                break;
            }
        }
        Self { name: own, hash: fingerprint(file) }
    }
}

/// `PROTOCOL_VERSION`: MAVLink 2 is sent, 1 is understood. It is deprecated, and asked for all the same.
pub fn protocol_version() -> Payload {
    let (message_id, seed) = (300, 217);
    // Current, least and greatest version, as hundredths; the hashes behind them are not known.
    Payload::new(message_id, seed, &[200, 0, 100, 0, 200, 0])
}

/// `AUTOPILOT_VERSION` of this package, with the hash of the policy as the custom version of the flight software.
pub fn autopilot_version(hash: [u8; 8]) -> Payload {
    let number = |text: &str| text.parse::<u8>().unwrap_or(0);
    let version = [
        number(env!("CARGO_PKG_VERSION_MAJOR")),
        number(env!("CARGO_PKG_VERSION_MINOR")),
        number(env!("CARGO_PKG_VERSION_PATCH")),
        0, // FIRMWARE_VERSION_TYPE_DEV
    ];
    Payload::of(&AUTOPILOT_VERSION_DATA {
        capabilities: MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_MAVLINK2
            | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_MISSION_INT
            | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_FTP
            | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_COMMAND_INT
            | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_PARAM_ENCODE_BYTEWISE
            | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_SET_ATTITUDE_TARGET
            | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_LOCAL_NED
            | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_SET_POSITION_TARGET_GLOBAL_INT
            | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_FLIGHT_TERMINATION
            | MavProtocolCapability::MAV_PROTOCOL_CAPABILITY_MISSION_FENCE,
        flight_sw_version: u32::from_be_bytes(version),
        flight_custom_version: hash,
        ..AUTOPILOT_VERSION_DATA::default()
    })
}

/// `COMPONENT_METADATA`: where the file is that says what else there is to read, and its CRC-32.
pub fn component_metadata(file_crc: u32, time_boot_ms: u32) -> Payload {
    Payload::of(&COMPONENT_METADATA_DATA { time_boot_ms, file_crc, uri: GENERAL_URI.into() })
}

/// `COMPONENT_INFORMATION`: the same. It is deprecated, and asked for all the same.
pub fn component_information(file_crc: u32, time_boot_ms: u32) -> Payload {
    let (message_id, seed) = (395, 0);
    // There is no file about peripherals: its checksum is zero, and its place stays empty.
    let numbers = [time_boot_ms, file_crc, 0].into_iter().flat_map(u32::to_le_bytes);
    let mut fields = [0; 212];
    fields.iter_mut().zip(numbers.chain(GENERAL_URI.bytes())).for_each(|(field, byte)| *field = byte);
    Payload::new(message_id, seed, &fields)
}

/// `AVAILABLE_MODES` of the mode at a place in the list of a personality; that of the policy bears its name.
pub fn available_mode(personality: Personality, place: usize, policy: &str) -> Option<Payload> {
    let listed = personality.listed();
    let mode = *listed.get(place)?;
    let own = if mode == FlightMode::Policy { policy } else { "" };
    let mut name = heapless::String::<MODE_NAME_LIMIT>::new();
    for letter in mode.name().chars().chain(own.chars()) {
        if name.push(letter).is_err() {
            break;
        }
    }
    Some(Payload::of(&AVAILABLE_MODES_DATA {
        custom_mode: personality.custom_mode(mode),
        properties: match mode {
            FlightMode::Position => MavModeProperty::empty(),
            FlightMode::Policy
            | FlightMode::Cascade
            | FlightMode::Hold
            | FlightMode::Offboard
            | FlightMode::TakeOff
            | FlightMode::Land
            | FlightMode::Return
            | FlightMode::Mission => MavModeProperty::MAV_MODE_PROPERTY_AUTO_MODE,
        },
        number_modes: listed.len() as u8,
        mode_index: place as u8 + 1,
        standard_mode: standard_mode(mode),
        mode_name: name.as_str().into(),
    }))
}

/// `AVAILABLE_MODES_MONITOR`: the list never changes.
pub fn available_modes_monitor() -> Payload {
    Payload::of(&AVAILABLE_MODES_MONITOR_DATA { seq: 1 })
}

/// The mode that does what a standard mode does, of `MAV_CMD_DO_SET_STANDARD_MODE`.
pub fn mode_of_standard(number: f32) -> Option<FlightMode> {
    let standard = |mode: &FlightMode| standard_mode(*mode);
    let is_standard = |mode: &FlightMode| standard(mode) != MavStandardMode::MAV_STANDARD_MODE_NON_STANDARD;
    FlightMode::ALL.into_iter().find(|mode| is_standard(mode) && f32::from(standard(mode) as u8) == number)
}

/// The standard mode that does what a mode does.
pub(super) const fn standard_mode(flight_mode: FlightMode) -> MavStandardMode {
    match flight_mode {
        FlightMode::Policy | FlightMode::Cascade | FlightMode::Hold | FlightMode::Offboard => {
            MavStandardMode::MAV_STANDARD_MODE_NON_STANDARD
        }
        FlightMode::Position => MavStandardMode::MAV_STANDARD_MODE_POSITION_HOLD,
        FlightMode::TakeOff => MavStandardMode::MAV_STANDARD_MODE_TAKEOFF,
        FlightMode::Land => MavStandardMode::MAV_STANDARD_MODE_LAND,
        FlightMode::Return => MavStandardMode::MAV_STANDARD_MODE_SAFE_RECOVERY,
        FlightMode::Mission => MavStandardMode::MAV_STANDARD_MODE_MISSION,
    }
}
