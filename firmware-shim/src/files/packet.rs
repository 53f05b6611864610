//! The packets of MAVLink FTP, which are the payload of `FILE_TRANSFER_PROTOCOL`.
//!
//! Source: <https://mavlink.io/en/services/ftp.html>.

/// Bytes of a packet.
pub const PACKET_LEN: usize = 251;

/// Bytes before the data.
const HEADER_LEN: usize = 12;

/// Bytes of data in a packet, at most.
pub const DATA_LIMIT: usize = PACKET_LEN - HEADER_LEN;

/// Operations of answers.
const ACKNOWLEDGED: u8 = 128;
const REFUSED: u8 = 129;

/// What a packet asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Operation {
    /// Nothing but an answer.
    Nothing,
    /// To close one file.
    TerminateSession,
    /// To close all of them.
    ResetSessions,
    /// What files there are.
    ListDirectory,
    /// To open a file for reading.
    OpenFile,
    /// A piece of an open file.
    ReadFile,
    /// To create, write, cut, rename or remove something.
    Write,
    /// The CRC-32 of a file.
    Checksum,
    /// Many pieces of an open file.
    BurstReadFile,
    /// It is an answer and asks for nothing.
    Answer,
    /// Nobody knows.
    Unknown,
}

/// Why a request is refused, with the protocol's numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum FileRefusal {
    /// More bytes than a packet holds, or none to read.
    InvalidDataSize = 3,
    /// This session is not open.
    InvalidSession = 4,
    /// Too many are.
    NoSessionsAvailable = 5,
    /// The offset is beyond the last byte or entry.
    EndOfFile = 6,
    /// No such operation.
    UnknownCommand = 7,
    /// Nothing can be written.
    FileProtected = 9,
    /// No file or folder has this name.
    FileNotFound = 10,
}

/// Where in a burst an answer stands.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Position {
    /// Others follow, or it is in none.
    Within,
    /// It is the last one.
    Last,
}

/// A request; whatever 251 bytes come are one.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct FileRequest {
    /// Its number.
    pub sequence: u16,
    /// The session that it is about.
    pub session: u8,
    /// Bytes of data, or bytes to be read.
    pub size: u8,
    /// First byte to be read, or first entry to be listed.
    pub offset: u32,
    operation: u8,
    data: [u8; DATA_LIMIT],
}

/// One of the answers to a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct FileAnswer<'a> {
    /// What it answers.
    pub request: &'a FileRequest,
    /// Which one it is, from 0.
    pub place: u16,
    /// The session that it is about.
    pub session: u8,
    /// Of its first byte in the file.
    pub offset: u32,
    /// Whether a burst ends with it.
    pub position: Position,
    /// At most [`DATA_LIMIT`] bytes, of which more are dropped, or why there are none.
    pub outcome: Result<&'a [u8], FileRefusal>,
}

impl Operation {
    const fn numbered(number: u8) -> Self {
        match number {
            0 => Self::Nothing,
            1 => Self::TerminateSession,
            2 => Self::ResetSessions,
            3 => Self::ListDirectory,
            4 => Self::OpenFile,
            5 => Self::ReadFile,
            6..=13 => Self::Write,
            14 => Self::Checksum,
            15 => Self::BurstReadFile,
            ACKNOWLEDGED | REFUSED => Self::Answer,
            _ => Self::Unknown,
        }
    }
}

impl FileRequest {
    /// In a packet.
    pub fn read(packet: &[u8; PACKET_LEN]) -> Self {
        let [low, high, session, operation, size, _, _, _, o0, o1, o2, o3, ref data @ ..] = *packet;
        Self {
            sequence: u16::from_le_bytes([low, high]),
            session,
            size,
            offset: u32::from_le_bytes([o0, o1, o2, o3]),
            operation,
            data: *data,
        }
    }

    /// What it asks for.
    pub const fn operation(&self) -> Operation {
        Operation::numbered(self.operation)
    }

    /// The path in its data, without the slashes at its beginning; some clients end it with a zero, others do not.
    ///
    /// # Errors
    /// [`FileRefusal::InvalidDataSize`], and [`FileRefusal::FileNotFound`] if it is no text.
    pub fn name(&self) -> Result<&str, FileRefusal> {
        let data = self.data.get(..self.size.into()).ok_or(FileRefusal::InvalidDataSize)?;
        let path = data.split(|byte| *byte == 0).next().unwrap_or_default();
        let path = str::from_utf8(path).map_err(|_| FileRefusal::FileNotFound)?;
        Ok(path.trim_start_matches('/'))
    }

    /// The one answer to it.
    pub const fn answer<'a>(&'a self, outcome: Result<&'a [u8], FileRefusal>) -> FileAnswer<'a> {
        FileAnswer {
            request: self,
            place: 0,
            session: self.session,
            offset: self.offset,
            position: Position::Within,
            outcome,
        }
    }

    /// The packet of the one answer with data of at most [`DATA_LIMIT`] bytes.
    pub fn acknowledge(&self, data: &[u8]) -> [u8; PACKET_LEN] {
        self.answer(Ok(data)).packet()
    }

    /// The packet of the one answer that says why not.
    pub fn refuse(&self, refusal: FileRefusal) -> [u8; PACKET_LEN] {
        self.answer(Err(refusal)).packet()
    }
}

impl FileAnswer<'_> {
    /// Its bytes.
    pub fn packet(&self) -> [u8; PACKET_LEN] {
        let (operation, data) = match self.outcome {
            Ok(data) => (ACKNOWLEDGED, data.get(..DATA_LIMIT).unwrap_or(data)),
            Err(refusal) => (REFUSED, &[refusal as u8][..]),
        };
        let [low, high] = self.request.sequence.wrapping_add(1).wrapping_add(self.place).to_le_bytes();
        let asked = self.request.operation;
        let ends = u8::from(self.position == Position::Last);
        let header = [low, high, self.session, operation, data.len() as u8, asked, ends, 0];
        let bytes = header.into_iter().chain(self.offset.to_le_bytes()).chain(data.iter().copied());
        let mut packet = [0; PACKET_LEN];
        packet.iter_mut().zip(bytes).for_each(|(place, byte)| *place = byte);
        packet
    }
}
