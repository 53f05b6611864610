//! Log blocks: lists of variables that are sent again and again.

use super::contents;
use super::number::Number;
use super::packet::{Fields, Packet, Port};
use super::status;
use super::variable::{LogSource, TABLE, Variable};

/// Channel on which blocks are made, started and stopped.
const CONTROL_CHANNEL: u8 = 1;

/// Channel on which they are sent.
const DATA_CHANNEL: u8 = 2;

/// Blocks that exist at the same time (the firmware's `LOG_MAX_BLOCKS`).
const BLOCKS: usize = 16;

/// Variables of all blocks together (the firmware's `LOG_MAX_OPS`).
const VARIABLES: usize = 128;

/// Bytes of the values of a block: a packet less its number and the time.
const BLOCK_BYTES: usize = 26;

/// A variable of a block, and as what it is sent.
#[derive(Clone, Copy, Debug)]
struct Item {
    variable: &'static Variable,
    number: Number,
}

/// When a block is sent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Schedule {
    Stopped,
    Once,
    Every { period_ms: u64, due_ms: u64 },
}

#[derive(Clone, Debug)]
struct Block {
    id: u8,
    items: heapless::Vec<Item, BLOCK_BYTES>,
    schedule: Schedule,
}

/// The blocks of one client.
#[derive(Clone, Debug, Default)]
pub struct Logging {
    blocks: heapless::Vec<Block, BLOCKS>,
}

impl Logging {
    /// Answers a packet at the log port, at `now_ms` of simulated time.
    pub fn receive(&mut self, packet: &Packet, now_ms: u64) -> Option<Packet> {
        match packet.channel {
            contents::CHANNEL => contents::answer(packet, &TABLE, &[BLOCKS as u8, VARIABLES as u8]),
            CONTROL_CHANNEL => {
                let mut fields = packet.fields();
                let command = fields.byte()?;
                let id = fields.byte().unwrap_or_default();
                let outcome = self.control(command, id, fields, now_ms);
                Some(packet.reply().with(&[command, id, outcome.err().unwrap_or(status::OK)]))
            }
            _ => None,
        }
    }

    fn control(&mut self, command: u8, id: u8, mut fields: Fields, now_ms: u64) -> Result<(), u8> {
        match command {
            2 => self.delete(id),
            3 => self.start(id, u64::from(fields.byte().unwrap_or_default()) * 10, now_ms),
            4 => self.block(id).map(|block| block.schedule = Schedule::Stopped),
            5 => {
                self.reset();
                Ok(())
            }
            6 => self.create(id, fields),
            7 => self.append(id, fields),
            8 => self.start(id, fields.short().unwrap_or_default().into(), now_ms),
            _ => Err(status::UNKNOWN_COMMAND),
        }
    }

    /// Forgets all blocks.
    pub fn reset(&mut self) {
        self.blocks.clear();
    }

    fn block(&mut self, id: u8) -> Result<&mut Block, u8> {
        self.blocks.iter_mut().find(|block| block.id == id).ok_or(status::NOT_FOUND)
    }

    fn create(&mut self, id: u8, fields: Fields) -> Result<(), u8> {
        if self.block(id).is_ok() {
            return Err(status::EXISTS);
        }
        let block = Block { id, items: heapless::Vec::new(), schedule: Schedule::Stopped };
        self.blocks.push(block).map_err(|_| status::NO_MEMORY)?;
        // Half a block would be in the way of the next try.
        self.append(id, fields).inspect_err(|_| self.blocks.retain(|block| block.id != id))
    }

    fn append(&mut self, id: u8, mut fields: Fields) -> Result<(), u8> {
        let mut room = VARIABLES - self.blocks.iter().map(|block| block.items.len()).sum::<usize>();
        let block = self.block(id)?;
        while let (Some(code), Some(index)) = (fields.byte(), fields.short()) {
            let variable = TABLE.get(usize::from(index)).ok_or(status::NOT_FOUND)?;
            let number = Number::of_log_code(code & 0x0F).ok_or(status::NOT_FOUND)?;
            if block.size() + number.size() > BLOCK_BYTES {
                return Err(status::TOO_BIG);
            }
            room = room.checked_sub(1).ok_or(status::NO_MEMORY)?;
            block.items.push(Item { variable, number }).map_err(|_| status::TOO_BIG)?;
        }
        Ok(())
    }

    fn delete(&mut self, id: u8) -> Result<(), u8> {
        self.block(id)?;
        self.blocks.retain(|block| block.id != id);
        Ok(())
    }

    /// A period of zero asks for one packet.
    fn start(&mut self, id: u8, period_ms: u64, now_ms: u64) -> Result<(), u8> {
        let every = Schedule::Every { period_ms, due_ms: now_ms + period_ms };
        self.block(id)?.schedule = if period_ms == 0 { Schedule::Once } else { every };
        Ok(())
    }

    /// Sends what is due at `now_ms` of simulated time.
    pub fn send_due(&mut self, source: &LogSource, now_ms: u64, send: &mut dyn FnMut(&Packet)) {
        for block in &mut self.blocks {
            if block.schedule.is_due(now_ms)
                && let Some(packet) = block.packet(source, now_ms)
            {
                send(&packet);
            }
        }
    }
}

impl Schedule {
    /// Whether a packet is due; if so, the next one is planned. What came too late is not made up for.
    fn is_due(&mut self, now_ms: u64) -> bool {
        match self {
            Self::Stopped => false,
            Self::Once => {
                *self = Self::Stopped;
                true
            }
            Self::Every { period_ms, due_ms } => {
                let due = now_ms >= *due_ms;
                if due {
                    *due_ms = (*due_ms + *period_ms).max(now_ms + 1);
                }
                due
            }
        }
    }
}

impl Block {
    /// Number of bytes of its values.
    fn size(&self) -> usize {
        self.items.iter().map(|item| item.number.size()).sum()
    }

    /// Its packet; none while a value is not finite.
    fn packet(&self, source: &LogSource, now_ms: u64) -> Option<Packet> {
        let [first, second, third, ..] = now_ms.to_le_bytes();
        let mut packet = Packet::new(Port::Log, DATA_CHANNEL).with(&[self.id, first, second, third]);
        for Item { variable, number } in &self.items {
            let value = variable.value(source);
            if !value.is_finite() {
                return None;
            }
            let stored = variable.number.read(&variable.number.write(value))?;
            packet = packet.with(&number.write(stored));
        }
        Some(packet)
    }
}

#[cfg(test)]
mod tests {
    use kestrel_core::airframe::CF2X;
    use nalgebra::Vector3;
    use proptest::prelude::*;

    use super::*;
    use crate::plant::{FlatFloor, Plant};

    const FLOAT: u8 = 7;
    const HALF: u8 = 8;

    struct Rig {
        logging: Logging,
        plant: FlatFloor,
    }

    impl Rig {
        fn new() -> Self {
            Self { logging: Logging::default(), plant: FlatFloor::new(&CF2X, 0.01) }
        }

        /// The status of a control command.
        fn control(&mut self, data: &[u8], now_ms: u64) -> u8 {
            let packet = Packet::new(Port::Log, CONTROL_CHANNEL).with(data);
            let reply = self.logging.receive(&packet, now_ms).unwrap();
            assert_eq!(reply.data()[..2], data[..2]);
            reply.data()[2]
        }

        fn sent(&mut self, now_ms: u64) -> Vec<Packet> {
            let (goal, ranges) = (Vector3::zeros(), self.plant.ranges());
            let source = LogSource { state: self.plant.state(), goal, supervision: 0, ranges };
            let mut sent = Vec::new();
            self.logging.send_due(&source, now_ms, &mut |packet| sent.push(packet.clone()));
            sent
        }
    }

    #[test]
    fn a_started_block_comes_once_in_a_period() {
        let mut rig = Rig::new();
        assert_eq!(rig.control(&[6, 1, FLOAT, 2, 0, HALF, 2, 0], 0), status::OK);
        assert!(rig.sent(0).is_empty(), "not started");
        assert_eq!(rig.control(&[3, 1, 5], 1000), status::OK);
        let times: Vec<u64> = (1000..=1300).step_by(10).filter(|now_ms| !rig.sent(*now_ms).is_empty()).collect();
        assert_eq!(times, [1050, 1100, 1150, 1200, 1250, 1300]);
        assert_eq!(rig.control(&[4, 1], 1300), status::OK);
        assert!(rig.sent(9000).is_empty(), "stopped");
    }

    #[test]
    fn a_block_holds_its_number_the_time_and_the_values() {
        let mut rig = Rig::new();
        rig.control(&[6, 9, FLOAT, 2, 0, HALF, 2, 0, 1, 2, 0], 0);
        assert_eq!(rig.control(&[8, 9, 0, 0], 0), status::OK);
        let mut expected = vec![9, 0x56, 0x34, 0x12];
        expected.extend(0.0125_f32.to_le_bytes());
        expected.extend([0x66, 0x22, 0]);
        let sent = rig.sent(0x0F12_3456);
        assert_eq!((sent.len(), sent[0].data(), sent[0].channel), (1, &expected[..], DATA_CHANNEL));
        assert!(rig.sent(0x0F12_3457).is_empty(), "once only");
    }

    #[test]
    fn blocks_that_cannot_be_are_refused_and_leave_nothing() {
        let mut rig = Rig::new();
        let seven_floats = [FLOAT, 0, 0].repeat(7);
        assert_eq!(rig.control(&[&[6, 1][..], &seven_floats].concat(), 0), status::TOO_BIG);
        assert_eq!(rig.control(&[6, 1, FLOAT, 0xFF, 0xFF], 0), status::NOT_FOUND);
        assert_eq!(rig.control(&[6, 1, 0, 0, 0], 0), status::NOT_FOUND);
        for command in [2, 3, 4, 7, 8] {
            assert_eq!(rig.control(&[command, 1], 0), status::NOT_FOUND, "{command}");
        }
        assert_eq!(rig.control(&[6, 1, FLOAT, 0, 0], 0), status::OK);
        assert_eq!(rig.control(&[6, 1, FLOAT, 0, 0], 0), status::EXISTS);
        assert_eq!(rig.control(&[7, 1, FLOAT, 1, 0], 0), status::OK);
        assert_eq!(rig.control(&[0, 1, FLOAT, 0], 0), status::UNKNOWN_COMMAND);
        assert_eq!(rig.control(&[2, 1], 0), status::OK);
        assert_eq!(rig.control(&[2, 1], 0), status::NOT_FOUND);
    }

    #[test]
    fn there_are_sixteen_blocks_and_128_variables() {
        let mut rig = Rig::new();
        for id in 0..16 {
            assert_eq!(rig.control(&[&[6, id][..], &[1, 0, 0].repeat(8)].concat(), 0), status::OK);
        }
        assert_eq!(rig.control(&[7, 3, 1, 0, 0], 0), status::NO_MEMORY, "variables");
        assert_eq!(rig.control(&[6, 16], 0), status::NO_MEMORY, "blocks");
        assert_eq!(rig.control(&[5, 0], 0), status::OK);
        assert_eq!(rig.control(&[6, 16, 1, 0, 0], 0), status::OK);
    }

    proptest! {
        #[test]
        fn no_packet_of_any_client_makes_a_packet_too_long(
            packets in proptest::collection::vec((0_u8..4, proptest::collection::vec(0_u8..12, 0..=30)), 0..60)
        ) {
            let mut rig = Rig::new();
            for (now_ms, (channel, data)) in packets.into_iter().enumerate() {
                let packet = Packet::new(Port::Log, channel).with(&data);
                rig.logging.receive(&packet, now_ms as u64 * 10);
                for packet in rig.sent(now_ms as u64 * 10) {
                    prop_assert!((4..=30).contains(&packet.data().len()));
                }
            }
        }
    }
}
