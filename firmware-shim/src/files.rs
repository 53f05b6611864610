//! Files that peers list and read by MAVLink FTP, and none that they write: requests in, answers out; no socket, no clock and
//! no file of this machine.
//!
//! [`packet`] knows the bytes, [`metadata`] says what files there are. Several ground stations may read at once.

pub mod metadata;
pub mod packet;

use packet::{DATA_LIMIT, FileAnswer, FileRefusal, FileRequest, Operation, PACKET_LEN, Position};

use crate::parameter::protocol::checksum;

/// Files that are open at once, those of all peers together.
const SESSIONS: usize = 8;

/// Peers whose last exchange is remembered.
const EXCHANGES: usize = 8;

/// A session without a request for so long is given up \[s\], and a request after so long is a new one: clients repeat one for
/// 5 s at most.
const IDLE_SECS: f64 = 10.0;

/// Answers to one request to read a burst; clients ask for the next one then. A vehicle has 32 wait to be sent.
const BURST_PACKETS: usize = 20;

/// Answers to a request, or why there are none but one that says so.
type Answers = Result<Vec<[u8; PACKET_LEN]>, FileRefusal>;

/// A file in the one folder that there is.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ServedFile {
    name: &'static str,
    content: Vec<u8>,
    checksum: u32,
}

/// What is open, and what was answered last.
#[derive(Debug)]
pub struct FileServer {
    files: Vec<ServedFile>,
    sessions: Vec<Session>,
    exchanges: Vec<Exchange>,
}

/// An open file of a peer. Peers count their own sessions, each from 0: MAVSDK never asks for another one.
#[derive(Debug)]
struct Session {
    owner: [u8; 2],
    number: u8,
    /// Its place among the files.
    file: usize,
    /// When it was asked for last.
    secs: f64,
}

/// The last request of a peer, which comes again if an answer was lost.
#[derive(Debug)]
struct Exchange {
    sender: [u8; 2],
    request: [u8; PACKET_LEN],
    answers: Vec<[u8; PACKET_LEN]>,
    secs: f64,
}

impl ServedFile {
    /// A file of this name, without a folder.
    pub fn new(name: &'static str, content: Vec<u8>) -> Self {
        Self { name, checksum: checksum(0, &content), content }
    }

    /// CRC-32 that begins and ends without inversion, as PX4's, MAVSDK's and QGroundControl's.
    pub const fn checksum(&self) -> u32 {
        self.checksum
    }
}

impl FileServer {
    /// Of these files, which never change.
    pub fn new(files: Vec<ServedFile>) -> Self {
        Self { files, sessions: Vec::new(), exchanges: Vec::new() }
    }

    /// CRC-32 of the file of a name, if there is one.
    pub fn checksum(&self, name: &str) -> Option<u32> {
        self.files.iter().find(|file| file.name == name).map(ServedFile::checksum)
    }

    /// The answers to a packet of `sender` (system, component), in their order; a packet that comes again within 10 s, with
    /// nothing else in between, is answered again in the same words. What is itself an answer gets none.
    pub fn handle(&mut self, packet: &[u8; PACKET_LEN], sender: [u8; 2], now_secs: f64) -> &[[u8; PACKET_LEN]] {
        let request = FileRequest::read(packet);
        if request.operation() == Operation::Answer {
            return &[];
        }
        let known = self.exchanges.iter().position(|last| last.is_repeated(packet, sender, now_secs));
        let place = known.unwrap_or_else(|| {
            let answers = self.execute(&request, sender, now_secs);
            let answers = answers.unwrap_or_else(|refusal| vec![request.refuse(refusal)]);
            self.remember(Exchange { sender, request: *packet, answers, secs: now_secs })
        });
        self.exchanges.get(place).map_or(&[], |exchange| &exchange.answers)
    }

    fn execute(&mut self, request: &FileRequest, sender: [u8; 2], now_secs: f64) -> Answers {
        match request.operation() {
            Operation::Nothing => Ok(vec![request.acknowledge(&[])]),
            Operation::TerminateSession => self.terminate(request, sender),
            Operation::ResetSessions => {
                // Those of others are none of its business.
                self.sessions.retain(|session| session.owner != sender);
                Ok(vec![request.acknowledge(&[])])
            }
            Operation::ListDirectory => self.list(request),
            Operation::OpenFile => self.open(request, sender, now_secs),
            Operation::ReadFile => self.read(request, sender, now_secs),
            Operation::Checksum => {
                let (_, file) = self.file(request)?;
                Ok(vec![request.acknowledge(&file.checksum.to_le_bytes())])
            }
            Operation::BurstReadFile => self.read_burst(request, sender, now_secs),
            Operation::Write => Err(FileRefusal::FileProtected),
            Operation::Answer | Operation::Unknown => Err(FileRefusal::UnknownCommand),
        }
    }

    fn terminate(&mut self, request: &FileRequest, sender: [u8; 2]) -> Answers {
        let before = self.sessions.len();
        self.sessions.retain(|session| !session.is(request.session, sender));
        if self.sessions.len() == before {
            return Err(FileRefusal::InvalidSession);
        }
        Ok(vec![request.acknowledge(&[])])
    }

    /// The entries of the folder from the one at the offset, as many as there is room for.
    fn list(&self, request: &FileRequest) -> Answers {
        if !["", "."].contains(&request.name()?) {
            return Err(FileRefusal::FileNotFound);
        }
        let mut entries = Vec::new();
        for ServedFile { name, content, .. } in self.files.iter().skip(request.offset as usize) {
            let entry = format!("F{name}\t{}\0", content.len());
            if entries.len() + entry.len() > DATA_LIMIT {
                break;
            }
            entries.extend(entry.bytes());
        }
        if entries.is_empty() { Err(FileRefusal::EndOfFile) } else { Ok(vec![request.acknowledge(&entries)]) }
    }

    /// Opens a file in the sender's first free session.
    fn open(&mut self, request: &FileRequest, sender: [u8; 2], now_secs: f64) -> Answers {
        let (place, file) = self.file(request)?;
        let len = (file.content.len() as u32).to_le_bytes();
        self.make_room(sender, now_secs)?;
        let is_open = |number: &u8| self.sessions.iter().any(|session| session.is(*number, sender));
        let free = (0..=u8::MAX).find(|number| !is_open(number));
        let number = free.ok_or(FileRefusal::NoSessionsAvailable)?;
        self.sessions.push(Session { owner: sender, number, file: place, secs: now_secs });
        let answer = FileAnswer { session: number, ..request.answer(Ok(&len)) };
        Ok(vec![answer.packet()])
    }

    /// Gives up sessions that lie idle: all of the sender's, and the oldest of others if there is no room else.
    fn make_room(&mut self, sender: [u8; 2], now_secs: f64) -> Result<(), FileRefusal> {
        let is_idle = |session: &Session| now_secs - session.secs >= IDLE_SECS;
        self.sessions.retain(|session| session.owner != sender || !is_idle(session));
        if self.sessions.len() < SESSIONS {
            return Ok(());
        }
        let idle = self.sessions.iter().enumerate().filter(|(_, session)| is_idle(session));
        let oldest = idle.min_by(|(_, a), (_, b)| a.secs.total_cmp(&b.secs)).map(|(place, _)| place);
        self.sessions.remove(oldest.ok_or(FileRefusal::NoSessionsAvailable)?);
        Ok(())
    }

    fn read(&mut self, request: &FileRequest, sender: [u8; 2], now_secs: f64) -> Answers {
        let size = usize::from(request.size);
        if size == 0 || size > DATA_LIMIT {
            return Err(FileRefusal::InvalidDataSize);
        }
        let rest = self.rest(request, sender, now_secs)?;
        Ok(vec![request.acknowledge(rest.get(..size).unwrap_or(rest))])
    }

    /// Reads on in pieces of the size that is asked for, or in the greatest ones.
    fn read_burst(&mut self, request: &FileRequest, sender: [u8; 2], now_secs: f64) -> Answers {
        let size = if request.size == 0 { DATA_LIMIT } else { usize::from(request.size) };
        if size > DATA_LIMIT {
            return Err(FileRefusal::InvalidDataSize);
        }
        let rest = self.rest(request, sender, now_secs)?;
        let burst = rest.get(..BURST_PACKETS * size).unwrap_or(rest);
        let mut pieces = burst.chunks(size).enumerate().peekable();
        let mut answers = Vec::new();
        while let Some((place, data)) = pieces.next() {
            let position = if pieces.peek().is_some() { Position::Within } else { Position::Last };
            let offset = request.offset + (place * size) as u32;
            let answer = FileAnswer { place: place as u16, offset, position, ..request.answer(Ok(data)) };
            answers.push(answer.packet());
        }
        Ok(answers)
    }

    /// What a session's file holds from the offset on, which is something.
    fn rest(&mut self, request: &FileRequest, sender: [u8; 2], now_secs: f64) -> Result<&[u8], FileRefusal> {
        let mut sessions = self.sessions.iter_mut();
        let session = sessions.find(|session| session.is(request.session, sender));
        let session = session.ok_or(FileRefusal::InvalidSession)?;
        session.secs = now_secs;
        let file = self.files.get(session.file).ok_or(FileRefusal::FileNotFound)?;
        let rest = file.content.get(request.offset as usize..).unwrap_or_default();
        if rest.is_empty() { Err(FileRefusal::EndOfFile) } else { Ok(rest) }
    }

    /// The file that a request names, and its place.
    fn file(&self, request: &FileRequest) -> Result<(usize, &ServedFile), FileRefusal> {
        let name = request.name()?;
        self.files.iter().enumerate().find(|(_, file)| file.name == name).ok_or(FileRefusal::FileNotFound)
    }

    /// Remembers an exchange in the place of the sender's last one, or of the oldest; the place.
    fn remember(&mut self, exchange: Exchange) -> usize {
        let own = self.exchanges.iter().position(|last| last.sender == exchange.sender);
        if own.is_none() && self.exchanges.len() < EXCHANGES {
            self.exchanges.push(exchange);
            return self.exchanges.len() - 1;
        }
        let by_age = |(_, a): &(usize, &Exchange), (_, b): &(usize, &Exchange)| a.secs.total_cmp(&b.secs);
        let oldest = self.exchanges.iter().enumerate().min_by(by_age).map(|(place, _)| place);
        let place = own.or(oldest).unwrap_or_default();
        if let Some(last) = self.exchanges.get_mut(place) {
            *last = exchange;
        }
        place
    }
}

impl Session {
    fn is(&self, number: u8, owner: [u8; 2]) -> bool {
        self.number == number && self.owner == owner
    }
}

impl Exchange {
    /// Whether a packet is the same request again. Its number is not enough: MAVSDK begins every download with number 0.
    fn is_repeated(&self, packet: &[u8; PACKET_LEN], sender: [u8; 2], now_secs: f64) -> bool {
        self.sender == sender && self.request == *packet && now_secs - self.secs < IDLE_SECS
    }
}

#[cfg(test)]
mod tests;
