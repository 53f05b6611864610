//! Parameters: what clients of a Crazyflie set, with the firmware's names and types.
//!
//! Most of them choose among things that this vehicle has one of (estimator, controller), and are kept without
//! effect so that clients find what they look for.

use super::contents::{self, Listed};
use super::number::Number::{self, Float, U8, U16, U32};
use super::packet::Packet;
use super::status;

/// Channels of the parameter port besides that of the table.
const READ_CHANNEL: u8 = 1;
const WRITE_CHANNEL: u8 = 2;
const MISCELLANEOUS_CHANNEL: u8 = 3;

/// Bit of the type that forbids writing.
const READ_ONLY: u8 = 0x40;

/// Who changes a parameter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Access {
    Client,
    ReadOnly,
}

/// One parameter of the table.
#[derive(Clone, Copy, Debug)]
pub struct CrtpParameter {
    group: &'static str,
    name: &'static str,
    number: Number,
    access: Access,
    initial: f64,
}

impl CrtpParameter {
    /// That clients set.
    const fn set(group: &'static str, name: &'static str, number: Number, initial: f64) -> Self {
        Self { group, name, number, access: Access::Client, initial }
    }

    /// That says what is there.
    const fn fact(group: &'static str, name: &'static str, number: Number, value: f64) -> Self {
        Self { group, name, number, access: Access::ReadOnly, initial: value }
    }
}

impl Listed for CrtpParameter {
    fn group(&self) -> &'static str {
        self.group
    }

    fn name(&self) -> &'static str {
        self.name
    }

    fn code(&self) -> u8 {
        let code = self.number.parameter_code();
        match self.access {
            Access::Client => code,
            Access::ReadOnly => code | READ_ONLY,
        }
    }
}

/// Number of parameters.
const COUNT: usize = 38;

/// Every parameter; its index is its number on the wire.
pub const TABLE: [CrtpParameter; COUNT] = [
    CrtpParameter::set("stabilizer", "stop", U8, 0.0),
    CrtpParameter::set("hlCommander", "groupmask", U8, 0.0),
    CrtpParameter::set("hlCommander", "vtoff", Float, 0.5),
    CrtpParameter::set("hlCommander", "vland", Float, 0.5),
    CrtpParameter::set("flightmode", "posSet", U8, 0.0),
    // From here on without effect.
    CrtpParameter::set("flightmode", "althold", U8, 0.0),
    CrtpParameter::set("flightmode", "poshold", U8, 0.0),
    CrtpParameter::set("flightmode", "yawMode", U8, 1.0),
    CrtpParameter::set("flightmode", "stabModeRoll", U8, 1.0),
    CrtpParameter::set("flightmode", "stabModePitch", U8, 1.0),
    CrtpParameter::set("flightmode", "stabModeYaw", U8, 0.0),
    CrtpParameter::set("stabilizer", "estimator", U8, 2.0),
    CrtpParameter::set("stabilizer", "controller", U8, 1.0),
    CrtpParameter::set("commander", "enHighLevel", U8, 1.0),
    CrtpParameter::set("kalman", "resetEstimation", U8, 0.0),
    CrtpParameter::set("kalman", "initialX", Float, 0.0),
    CrtpParameter::set("kalman", "initialY", Float, 0.0),
    CrtpParameter::set("kalman", "initialZ", Float, 0.0),
    CrtpParameter::set("kalman", "initialYaw", Float, 0.0),
    CrtpParameter::set("locSrv", "extPosStdDev", Float, 0.01),
    CrtpParameter::set("locSrv", "extQuatStdDev", Float, 0.0045),
    CrtpParameter::set("supervisor", "tmblChckEn", U8, 1.0),
    CrtpParameter::set("led", "bitmask", U8, 0.0),
    // The vehicle knows where it is and how it moves, as with this deck. Not with a Lighthouse: cfclient reads its memories.
    CrtpParameter::fact("deck", "bcFlow2", U8, 1.0),
    CrtpParameter::fact("deck", "bcLighthouse4", U8, 0.0),
    CrtpParameter::fact("deck", "bcFlow", U8, 0.0),
    CrtpParameter::fact("deck", "bcZRanger", U8, 0.0),
    CrtpParameter::fact("deck", "bcZRanger2", U8, 0.0),
    CrtpParameter::fact("deck", "bcMultiranger", U8, 1.0),
    CrtpParameter::fact("deck", "bcDWM1000", U8, 0.0),
    CrtpParameter::fact("deck", "bcLoco", U8, 0.0),
    CrtpParameter::fact("deck", "bcLedRing", U8, 0.0),
    CrtpParameter::fact("deck", "bcBuzzer", U8, 0.0),
    CrtpParameter::fact("deck", "bcAI", U8, 0.0),
    CrtpParameter::fact("deck", "bcUSD", U8, 0.0),
    CrtpParameter::fact("firmware", "revision0", U32, 0.0),
    CrtpParameter::fact("firmware", "revision1", U16, 0.0),
    CrtpParameter::fact("firmware", "modified", U8, 1.0),
];

/// The values of the table, all finite.
#[derive(Clone, Debug)]
pub struct CrtpParameters {
    values: [f64; COUNT],
}

impl Default for CrtpParameters {
    fn default() -> Self {
        Self { values: TABLE.map(|parameter| parameter.initial) }
    }
}

impl CrtpParameters {
    /// Whether the motors are to be stopped for good.
    pub fn stop(&self) -> bool {
        self.values[0] != 0.0
    }

    /// Groups of the swarm in which the vehicle is, as bits.
    pub fn groups(&self) -> u8 {
        self.values[1] as u8
    }

    /// Puts the vehicle into groups of the swarm.
    pub fn join_groups(&mut self, groups: u8) {
        self.values[1] = groups.into();
    }

    /// Speed of take-offs that name none \[m/s\].
    pub fn take_off_speed(&self) -> f32 {
        self.values[2] as f32
    }

    /// Speed of landings that name none \[m/s\].
    pub fn landing_speed(&self) -> f32 {
        self.values[3] as f32
    }

    /// Whether the set-points of the old commander are positions.
    pub fn sets_positions(&self) -> bool {
        self.values[4] != 0.0
    }

    /// Answers a packet at the parameter port.
    pub fn receive(&mut self, packet: &Packet) -> Option<Packet> {
        match packet.channel {
            contents::CHANNEL => contents::answer(packet, &TABLE, &[]),
            READ_CHANNEL => self.read(packet),
            WRITE_CHANNEL => self.write(packet),
            MISCELLANEOUS_CHANNEL => self.answer(packet),
            _ => None,
        }
    }

    fn read(&self, packet: &Packet) -> Option<Packet> {
        let index = packet.fields().short()?;
        let reply = packet.reply().with(&index.to_le_bytes());
        let Some(value) = self.bytes(index) else { return Some(reply.with(&[status::NOT_FOUND])) };
        Some(reply.with(&[status::OK]).with(&value))
    }

    /// Echoes the value that is now set; as from the firmware, no answer if the parameter may only be read.
    fn write(&mut self, packet: &Packet) -> Option<Packet> {
        let mut fields = packet.fields();
        let index = fields.short()?;
        let reply = packet.reply().with(&index.to_le_bytes());
        match self.set(index.into(), fields.0) {
            Err(status::NOT_FOUND) => Some(reply.with(&[status::NOT_FOUND])),
            Err(status::READ_ONLY) => None,
            Ok(()) | Err(_) => Some(reply.with(&self.bytes(index)?)),
        }
    }

    fn set(&mut self, index: usize, bytes: &[u8]) -> Result<(), u8> {
        let parameter = TABLE.get(index).ok_or(status::NOT_FOUND)?;
        match parameter.access {
            Access::ReadOnly => Err(status::READ_ONLY),
            Access::Client => {
                self.values[index] = parameter.number.read(bytes).ok_or(status::INVALID)?;
                Ok(())
            }
        }
    }

    /// Bytes of the value with this index.
    fn bytes(&self, index: u16) -> Option<super::number::Bytes> {
        let index = usize::from(index);
        Some(TABLE.get(index)?.number.write(self.values[index]))
    }

    /// Writes by name, default values, and persistence, which no parameter has.
    fn answer(&mut self, packet: &Packet) -> Option<Packet> {
        let mut fields = packet.fields();
        let command = fields.byte()?;
        if command == 0 {
            return self.write_by_name(packet);
        }
        let index = fields.short()?;
        let reply = packet.reply().with(&[command]).with(&index.to_le_bytes());
        match (command, default_bytes(index)) {
            (6, Some(value)) => Some(reply.with(&value)),
            (8, Some(value)) => Some(reply.with(&[status::OK]).with(&value)),
            (2..=8, _) => Some(reply.with(&[status::NOT_FOUND])),
            _ => None,
        }
    }

    fn write_by_name(&mut self, packet: &Packet) -> Option<Packet> {
        let mut fields = packet.fields();
        fields.byte()?;
        let (group, name) = (fields.text()?, fields.text()?);
        let code = fields.byte()?;
        let outcome = match TABLE.iter().position(|parameter| contents::is_called(parameter, group, name)) {
            None => Err(status::NOT_FOUND),
            Some(index) if TABLE[index].number.parameter_code() != code => Err(status::INVALID),
            Some(index) => self.set(index, fields.0),
        };
        let reply = packet.reply().with(&[0]).with(group).with(&[0]).with(name).with(&[0]);
        Some(reply.with(&[outcome.err().unwrap_or(status::OK)]))
    }
}

/// Bytes of the value at the start, unless the parameter may only be read.
fn default_bytes(index: u16) -> Option<super::number::Bytes> {
    let parameter = TABLE.get(usize::from(index))?;
    (parameter.access == Access::Client).then(|| parameter.number.write(parameter.initial))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::crtp::packet::Port;

    fn index(group: &str, name: &str) -> [u8; 2] {
        let is_it = |entry: &CrtpParameter| contents::is_called(entry, group.as_bytes(), name.as_bytes());
        (TABLE.iter().position(is_it).unwrap() as u16).to_le_bytes()
    }

    fn ask(parameters: &mut CrtpParameters, channel: u8, data: &[u8]) -> Option<Vec<u8>> {
        let packet = Packet::new(Port::Parameter, channel).with(data);
        parameters.receive(&packet).map(|reply| reply.data().to_vec())
    }

    #[test]
    fn the_table_fits_its_packets_and_names_nothing_twice() {
        contents::check(&TABLE);
    }

    /// Clients keep the table under this number. It may change only together with the table.
    #[test]
    fn the_checksum_of_the_table_is_stable() {
        assert_eq!(contents::checksum(&TABLE), 0xB645_AF57);
    }

    #[test]
    fn the_values_with_effect_stand_where_they_are_looked_for() {
        let mut parameters = CrtpParameters::default();
        assert_eq!((parameters.take_off_speed(), parameters.landing_speed()), (0.5, 0.5));
        let names = [("stabilizer", "stop"), ("hlCommander", "groupmask"), ("flightmode", "posSet")];
        for (group, name) in names {
            let [low, high] = index(group, name);
            ask(&mut parameters, WRITE_CHANNEL, &[low, high, 3]);
        }
        assert!(parameters.stop() && parameters.sets_positions());
        assert_eq!(parameters.groups(), 3);
    }

    #[test]
    fn what_is_written_is_echoed_and_read() {
        let mut parameters = CrtpParameters::default();
        let [low, high] = index("hlCommander", "vland");
        let [a, b, c, d] = 0.25_f32.to_le_bytes();
        assert_eq!(
            ask(&mut parameters, WRITE_CHANNEL, &[low, high, a, b, c, d]),
            Some(vec![low, high, a, b, c, d])
        );
        assert_eq!(ask(&mut parameters, READ_CHANNEL, &[low, high]), Some(vec![low, high, 0, a, b, c, d]));
        assert_eq!(parameters.landing_speed(), 0.25);
    }

    #[test]
    fn a_value_that_is_no_number_changes_nothing() {
        let mut parameters = CrtpParameters::default();
        let [low, high] = index("hlCommander", "vtoff");
        let [a, b, c, d] = 0.5_f32.to_le_bytes();
        for wrong in [f32::NAN, f32::INFINITY] {
            let data = [&[low, high][..], &wrong.to_le_bytes()].concat();
            assert_eq!(ask(&mut parameters, WRITE_CHANNEL, &data), Some(vec![low, high, a, b, c, d]));
        }
        assert_eq!(
            ask(&mut parameters, WRITE_CHANNEL, &[low, high, 1]),
            Some(vec![low, high, a, b, c, d]),
            "short"
        );
    }

    #[test]
    fn what_does_not_exist_is_not_found_and_facts_are_not_written() {
        let mut parameters = CrtpParameters::default();
        assert_eq!(ask(&mut parameters, READ_CHANNEL, &[0xFF, 0]), Some(vec![0xFF, 0, status::NOT_FOUND]));
        assert_eq!(ask(&mut parameters, WRITE_CHANNEL, &[0xFF, 0, 1]), Some(vec![0xFF, 0, status::NOT_FOUND]));
        let [low, high] = index("deck", "bcFlow2");
        assert_eq!(ask(&mut parameters, WRITE_CHANNEL, &[low, high, 0]), None);
        assert_eq!(ask(&mut parameters, READ_CHANNEL, &[low, high]), Some(vec![low, high, 0, 1]));
        assert_eq!(ask(&mut parameters, READ_CHANNEL, &[low]), None, "short");
    }

    #[test]
    fn names_can_be_written_too() {
        let mut parameters = CrtpParameters::default();
        let mut by_name = |tail: &[u8]| {
            let reply =
                ask(&mut parameters, MISCELLANEOUS_CHANNEL, &[b"\0stabilizer\0controller\0", tail].concat());
            reply.map(|reply| *reply.last().unwrap())
        };
        assert_eq!(by_name(&[8, 2]), Some(status::OK));
        assert_eq!(by_name(&[6, 2]), Some(status::INVALID), "another type");
        assert_eq!(by_name(&[8]), Some(status::INVALID), "no value");
        assert_eq!(by_name(&[]), None);
        let mut whole = |data: &[u8]| ask(&mut parameters, MISCELLANEOUS_CHANNEL, data);
        assert_eq!(whole(b"\0deck\0bcAI\0\x08\x01"), Some(b"\0deck\0bcAI\0\x0D".to_vec()));
        assert_eq!(whole(b"\0a\0b\0\x08\x01"), Some(b"\0a\0b\0\x02".to_vec()));
    }

    #[test]
    fn defaults_are_told_and_nothing_is_persistent() {
        let mut parameters = CrtpParameters::default();
        let [low, high] = index("stabilizer", "estimator");
        let mut ask = |command: u8, [low, high]: [u8; 2]| {
            ask(&mut parameters, MISCELLANEOUS_CHANNEL, &[command, low, high]).map(|reply| reply[3..].to_vec())
        };
        assert_eq!(ask(6, [low, high]), Some(vec![2]));
        assert_eq!(ask(8, [low, high]), Some(vec![0, 2]));
        assert_eq!(ask(8, index("deck", "bcAI")), Some(vec![status::NOT_FOUND]));
        for command in [2, 3, 4, 5, 7] {
            assert_eq!(ask(command, [low, high]), Some(vec![status::NOT_FOUND]), "{command}");
        }
        assert_eq!(ask(9, [low, high]), None);
    }

    proptest! {
        #[test]
        fn whatever_comes_every_value_stays_finite(
            packets in proptest::collection::vec((0_u8..4, proptest::collection::vec(any::<u8>(), 0..=30)), 0..40),
            index in 0_u8..40,
        ) {
            let mut parameters = CrtpParameters::default();
            for (channel, mut data) in packets {
                if let (2, [low, high, ..]) = (channel, &mut data[..]) {
                    (*low, *high) = (index, 0);
                }
                ask(&mut parameters, channel, &data);
                prop_assert!(parameters.values.iter().all(|value| value.is_finite()));
            }
        }
    }
}
