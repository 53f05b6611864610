//! An MCAP file of ROS 2 messages, in memory.

use std::collections::BTreeMap;
use std::io::Cursor;

use byteorder::LittleEndian;
use mcap::records::MessageHeader;
use mcap::{WriteOptions, Writer};

use crate::RosError;
use crate::definition::schema;
use crate::message::{Message, Time};

/// What stands before an encoded message: plain CDR, little-endian, no options.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// Of the time since the start at which a flight begins \[s\].
const BEGINNING_SECS: f64 = 1.0;

/// A file that is being written.
pub(crate) struct Bag {
    writer: Writer<Cursor<Vec<u8>>>,
    /// Number of a topic's channel.
    channels: BTreeMap<String, u16>,
    sequence: u32,
}

impl Bag {
    pub(crate) fn new() -> Result<Self, RosError> {
        let library = concat!("kestrel ", env!("CARGO_PKG_VERSION"));
        let options = WriteOptions::new().compression(None).profile("ros2").library(library);
        let writer = options.create(Cursor::new(Vec::new()))?;
        Ok(Self { writer, channels: BTreeMap::new(), sequence: 0 })
    }

    /// Adds a message of a time since the start of the flight \[s\].
    pub(crate) fn push<M: Message>(&mut self, topic: &str, secs: f64, message: &M) -> Result<(), RosError> {
        let channel_id = self.channel::<M>(topic)?;
        let mut data = ENCAPSULATION.to_vec();
        data.extend(cdr_encoding::to_vec::<M, LittleEndian>(message)?);
        let nanoseconds = ((secs + BEGINNING_SECS) * 1e9).round() as u64;
        let (log_time, publish_time) = (nanoseconds, nanoseconds);
        let header = MessageHeader { channel_id, sequence: self.sequence, log_time, publish_time };
        self.sequence += 1;
        Ok(self.writer.write_to_known_channel(&header, &data)?)
    }

    /// The file.
    pub(crate) fn finish(mut self) -> Result<Vec<u8>, RosError> {
        self.writer.finish()?;
        Ok(self.writer.into_inner().into_inner())
    }

    fn channel<M: Message>(&mut self, topic: &str) -> Result<u16, RosError> {
        if let Some(known) = self.channels.get(topic) {
            return Ok(*known);
        }
        // The file names a message by its package, kind and name.
        let name = M::NAME.replace('/', "/msg/");
        let schema = self.writer.add_schema(&name, "ros2msg", schema(M::NAME).as_bytes())?;
        let channel = self.writer.add_channel(schema, topic, "cdr", &BTreeMap::new())?;
        self.channels.insert(topic.to_owned(), channel);
        Ok(channel)
    }
}

/// A time since the start of the flight \[s\] as messages say it.
pub(crate) fn stamp(secs: f64) -> Time {
    Time::of(secs + BEGINNING_SECS)
}
