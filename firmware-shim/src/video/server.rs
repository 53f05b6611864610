//! Sockets and threads of the RTSP server: one thread accepts connections; each client has one that reads and one that
//! writes, so that a slow client delays only itself.

use std::hash::{BuildHasher, Hasher, RandomState};
use std::io::{self, ErrorKind, Read, Write};
use std::mem;
use std::net::{IpAddr, Ipv4Addr, Ipv6Addr, Shutdown, SocketAddr, TcpListener, TcpStream, UdpSocket};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{self, Receiver, RecvTimeoutError, SyncSender};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::thread::{self, JoinHandle};
use std::time::{Duration, Instant, SystemTime};

use super::rtp::{AccessUnit, RtpPacketizer};
use super::rtsp::{
    Incoming, METHODS, PATH, RtspMethod, RtspParser, RtspReply, RtspRequest, RtspStatus, RtspTransport, TRACK,
    describe, interleaved_header,
};
use super::{VideoError, VideoFormat};

/// Clients at a time; one more is told that there is no room.
pub(super) const CLIENTS: usize = 8;

/// Requests and pictures that wait for one client: a quarter of a second at 30 Hz. Pictures beyond are dropped.
const QUEUE_LEN: usize = 8;

/// A client that sends nothing for so long has gone, unless it takes packets from its connection (RFC 2326, section 12.37,
/// has 60 s as the default of a session).
const SILENCE_LIMIT: Duration = Duration::from_secs(60);

/// A connection that takes nothing for so long is closed: networks recover within a few seconds.
const STALL_LIMIT: Duration = Duration::from_secs(10);

/// From one look for connections to the next: short beside what a player takes to start.
const ACCEPT_INTERVAL: Duration = Duration::from_millis(20);

/// From one check of a silent client to the next: short beside [`SILENCE_LIMIT`].
const CHECK_INTERVAL: Duration = Duration::from_millis(200);

/// A refused client has so long to read why; a connection closed with unread bytes would discard the reply.
const FAREWELL_LIMIT: Duration = Duration::from_millis(500);

/// From one sender report to the next (RFC 3550, section 6.2, recommends 5 s).
const REPORT_INTERVAL: Duration = Duration::from_secs(5);

/// Bytes of one read from a socket: a few requests, or any receiver report.
const READ_LEN: usize = 4 << 10;

/// Reads of what a refused client, or a client that reports, has sent: an endless sender must not hold a thread.
const READS_AT_ONCE: usize = 16;

/// Tries for two adjacent free UDP ports, of which half start at an odd one.
const PORT_TRIES: usize = 64;

/// An RTSP server of one H.264 stream. Dropping it ends all connections and threads.
#[derive(Debug)]
pub struct RtspServer {
    shared: Arc<RtspShared>,
    address: SocketAddr,
    accepting: Option<JoinHandle<()>>,
}

/// What all threads of the server know.
#[derive(Debug)]
struct RtspShared {
    format: VideoFormat,
    silence_limit: Duration,
    clients: Mutex<Vec<RtspClient>>,
    key_wanted: AtomicBool,
    closing: AtomicBool,
}

/// A connection, from the outside.
#[derive(Debug)]
struct RtspClient {
    stream: TcpStream,
    playback: Arc<Mutex<Playback>>,
    events: SyncSender<ClientEvent>,
    thread: JoinHandle<()>,
}

/// Which pictures a client takes.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Playback {
    /// None.
    #[default]
    Paused,
    /// None before a key picture, which has been asked for.
    Starting,
    /// None before a key picture: some did not fit into its queue.
    Behind,
    /// All.
    Playing,
}

/// What the thread that writes to a client reacts to.
#[derive(Debug)]
enum ClientEvent {
    /// From the client.
    Incoming(Incoming),
    /// The client sent something else: the last thing that it is told.
    Refused(RtspReply),
    /// The client closed the connection.
    Closed,
    /// For the client.
    Picture(Arc<AccessUnit>),
}

impl RtspServer {
    /// Listens at an address; port 0 lets the operating system choose.
    ///
    /// # Errors
    /// [`VideoError::Listen`], or [`VideoError::ParameterSet`] if the format's sequence parameter set is none.
    pub fn open(address: SocketAddr, format: VideoFormat) -> Result<Self, VideoError> {
        Self::with_silence_limit(address, format, SILENCE_LIMIT)
    }

    pub(super) fn with_silence_limit(
        address: SocketAddr,
        format: VideoFormat,
        silence_limit: Duration,
    ) -> Result<Self, VideoError> {
        if format.profile_and_level().is_none() {
            return Err(VideoError::ParameterSet { len: format.sequence_parameter_set.len() });
        }
        let shared = Arc::new(RtspShared {
            format,
            silence_limit,
            clients: Mutex::default(),
            key_wanted: AtomicBool::new(false),
            closing: AtomicBool::new(false),
        });
        let started = || {
            let listener = TcpListener::bind(address)?;
            listener.set_nonblocking(true)?;
            let bound = listener.local_addr()?;
            let shared = Arc::clone(&shared);
            let accepting =
                thread::Builder::new().name("rtsp".into()).spawn(move || accept(&listener, &shared))?;
            Ok((bound, accepting))
        };
        let (bound, accepting) = started().map_err(|reason| VideoError::Listen { address, reason })?;
        Ok(Self { shared, address: bound, accepting: Some(accepting) })
    }

    /// The bound address.
    pub fn address(&self) -> SocketAddr {
        self.address
    }

    /// What a player on this machine opens.
    pub fn url(&self) -> String {
        let ip = match self.address.ip() {
            IpAddr::V4(ip) if ip.is_unspecified() => Ipv4Addr::LOCALHOST.into(),
            IpAddr::V6(ip) if ip.is_unspecified() => Ipv6Addr::LOCALHOST.into(),
            ip @ (IpAddr::V4(_) | IpAddr::V6(_)) => ip,
        };
        format!("rtsp://{}{PATH}", SocketAddr::new(ip, self.address.port()))
    }

    /// Whether a client plays the stream: pictures need not be encoded otherwise.
    pub fn is_watched(&self) -> bool {
        self.shared.clients().iter().any(|client| *lock(&client.playback) != Playback::Paused)
    }

    /// Whether, since the last call, a client began to play, or has taken what waited for it after pictures were dropped: it
    /// needs a key picture.
    pub fn take_newcomers(&self) -> bool {
        self.shared.key_wanted.swap(false, Ordering::AcqRel)
    }

    /// Sends one picture to all clients that play: an access unit with start codes (H.264, annex B), taken `secs` \[s\] after
    /// the start of the stream. It never waits; a client whose queue is full misses all pictures up to the next key picture.
    pub fn send(&self, access_unit: &[u8], secs: f64) {
        let access_unit = Arc::new(AccessUnit::parse(access_unit, secs));
        self.shared.clients().iter().for_each(|client| client.offer(&access_unit));
    }
}

impl Drop for RtspServer {
    fn drop(&mut self) {
        self.shared.closing.store(true, Ordering::Release);
        if let Some(accepting) = self.accepting.take() {
            accepting.thread().unpark();
            join(accepting);
        }
        let clients = mem::take(&mut *self.shared.clients());
        for client in &clients {
            shut(&client.stream, Shutdown::Both);
        }
        for client in clients {
            join(client.thread);
        }
    }
}

impl RtspShared {
    fn clients(&self) -> MutexGuard<'_, Vec<RtspClient>> {
        lock(&self.clients)
    }
}

impl RtspClient {
    fn offer(&self, access_unit: &Arc<AccessUnit>) {
        let mut playback = lock(&self.playback);
        let wanted = match *playback {
            Playback::Paused => false,
            Playback::Starting | Playback::Behind => access_unit.is_key(),
            Playback::Playing => true,
        };
        if wanted {
            let queued = self.events.try_send(ClientEvent::Picture(Arc::clone(access_unit)));
            *playback = if queued.is_ok() { Playback::Playing } else { Playback::Behind };
        }
    }
}

/// The content, even if a thread panicked: each is valid at any time.
fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A thread that panicked has printed why; the others go on.
fn join(thread: JoinHandle<()>) {
    let _ = thread.join();
}

/// A connection that is closed already cannot be shut down, and need not be.
fn shut(stream: &TcpStream, direction: Shutdown) {
    let _ = stream.shutdown(direction);
}

/// Accepts connections until the server closes.
fn accept(listener: &TcpListener, shared: &Arc<RtspShared>) {
    while !shared.closing.load(Ordering::Acquire) {
        shared.clients().retain(|client| !client.thread.is_finished());
        match listener.accept() {
            // A connection that breaks at once concerns no other.
            Ok((stream, _)) => drop(admit(stream, shared)),
            Err(_) => thread::park_timeout(ACCEPT_INTERVAL),
        }
    }
}

fn admit(stream: TcpStream, shared: &Arc<RtspShared>) -> io::Result<()> {
    stream.set_nonblocking(false)?;
    stream.set_nodelay(true)?;
    stream.set_write_timeout(Some(STALL_LIMIT))?;
    let mut clients = shared.clients();
    if clients.len() >= CLIENTS {
        drop(clients);
        return turn_away(&stream);
    }
    let playback = Arc::default();
    let (events, received) = mpsc::sync_channel(QUEUE_LEN);
    let connection = RtspConnection {
        stream: stream.try_clone()?,
        shared: Arc::clone(shared),
        playback: Arc::clone(&playback),
        session: None,
        heard: Instant::now(),
    };
    let incoming = events.clone();
    let named = thread::Builder::new().name("rtsp client".into());
    let thread = named.spawn(move || connection.run(incoming, received))?;
    clients.push(RtspClient { stream, playback, events, thread });
    Ok(())
}

/// Tells a client, which gets a moment to ask, that there is no room.
fn turn_away(stream: &TcpStream) -> io::Result<()> {
    stream.set_read_timeout(Some(FAREWELL_LIMIT))?;
    let mut parser = RtspParser::default();
    let mut bytes = [0; READ_LEN];
    let len = (&*stream).read(&mut bytes).unwrap_or(0);
    parser.push(bytes.get(..len).unwrap_or_default());
    let sequence = match parser.take() {
        Ok(Some(Incoming::Request(request))) => Some(request.sequence),
        Ok(Some(Incoming::Packet) | None) | Err(_) => None,
    };
    (&*stream).write_all(&RtspReply::new(RtspStatus::Unavailable, sequence).to_bytes())?;
    part(stream)
}

/// Closes a connection once the client has read what it was sent.
fn part(stream: &TcpStream) -> io::Result<()> {
    shut(stream, Shutdown::Write);
    stream.set_read_timeout(Some(FAREWELL_LIMIT))?;
    for _ in 0..READS_AT_ONCE {
        if (&*stream).read(&mut [0; READ_LEN])? == 0 {
            break;
        }
    }
    Ok(())
}

/// Reads what a client sends until it closes, or sends what is no request.
fn read(mut stream: TcpStream, events: &SyncSender<ClientEvent>) {
    let mut parser = RtspParser::default();
    let mut bytes = [0; READ_LEN];
    loop {
        let event = match parser.take() {
            Ok(Some(incoming)) => ClientEvent::Incoming(incoming),
            Err(reply) => ClientEvent::Refused(reply),
            Ok(None) => match stream.read(&mut bytes) {
                Err(error) if error.kind() == ErrorKind::Interrupted => continue,
                Ok(0) | Err(_) => ClientEvent::Closed,
                Ok(len) => {
                    parser.push(bytes.get(..len).unwrap_or_default());
                    continue;
                }
            },
        };
        let last = matches!(event, ClientEvent::Refused(_) | ClientEvent::Closed);
        if events.send(event).is_err() || last {
            return;
        }
    }
}

/// A connection, as the thread that writes to it has it.
struct RtspConnection {
    stream: TcpStream,
    shared: Arc<RtspShared>,
    playback: Arc<Mutex<Playback>>,
    session: Option<RtspSession>,
    /// When the client last sent something whole.
    heard: Instant,
}

/// What a client has set up.
struct RtspSession {
    id: String,
    delivery: RtpDelivery,
    packetizer: RtpPacketizer,
    /// When the last sender report was sent.
    reported: Option<Instant>,
}

/// Where packets are sent.
enum RtpDelivery {
    Interleaved { rtp_channel: u8, rtcp_channel: u8 },
    Udp { rtp: UdpPath, rtcp: UdpPath },
}

/// A socket of the server and a port of a client.
struct UdpPath {
    socket: UdpSocket,
    client: SocketAddr,
}

impl RtspConnection {
    fn run(mut self, incoming: SyncSender<ClientEvent>, events: Receiver<ClientEvent>) {
        let reading = self.stream.try_clone().and_then(|stream| {
            thread::Builder::new().name("rtsp reader".into()).spawn(move || read(stream, &incoming))
        });
        if reading.is_ok() {
            // Whatever fails, the connection ends.
            let _ = self.react(&events);
        }
        *lock(&self.playback) = Playback::Paused;
        shut(&self.stream, Shutdown::Both);
        drop(events);
        reading.into_iter().for_each(join);
    }

    fn react(&mut self, events: &Receiver<ClientEvent>) -> io::Result<()> {
        loop {
            match self.next_event(events) {
                Ok(ClientEvent::Incoming(incoming)) => {
                    self.heard = Instant::now();
                    if let Incoming::Request(request) = incoming {
                        let reply = self.reply(&request);
                        self.stream.write_all(&reply.to_bytes())?;
                    }
                }
                Ok(ClientEvent::Refused(reply)) => {
                    self.stream.write_all(&reply.to_bytes())?;
                    return part(&self.stream);
                }
                Ok(ClientEvent::Picture(access_unit)) => self.send(&access_unit)?,
                Err(RecvTimeoutError::Timeout) => (),
                Ok(ClientEvent::Closed) | Err(RecvTimeoutError::Disconnected) => return Ok(()),
            }
            if self.is_silent() {
                return Ok(());
            }
        }
    }

    fn next_event(&self, events: &Receiver<ClientEvent>) -> Result<ClientEvent, RecvTimeoutError> {
        if let Ok(event) = events.try_recv() {
            return Ok(event);
        }
        let mut playback = lock(&self.playback);
        if *playback == Playback::Behind {
            *playback = Playback::Starting;
            self.shared.key_wanted.store(true, Ordering::Release);
        }
        drop(playback);
        events.recv_timeout(CHECK_INTERVAL)
    }

    /// Whether the client has been silent for too long. One that takes packets from its connection is there; one that takes
    /// datagrams has to report.
    fn is_silent(&mut self) -> bool {
        match self.session.as_ref().map(|session| &session.delivery) {
            Some(RtpDelivery::Interleaved { .. }) if self.is_playing() => return false,
            Some(RtpDelivery::Udp { rtcp, .. }) if rtcp.reports() => self.heard = Instant::now(),
            Some(RtpDelivery::Interleaved { .. } | RtpDelivery::Udp { .. }) | None => (),
        }
        self.heard.elapsed() > self.shared.silence_limit
    }

    fn is_playing(&self) -> bool {
        *lock(&self.playback) != Playback::Paused
    }

    fn send(&mut self, access_unit: &AccessUnit) -> io::Result<()> {
        // Pictures may still wait when a client pauses.
        let Some(session) = self.session.as_mut().filter(|_| *lock(&self.playback) != Playback::Paused) else {
            return Ok(());
        };
        let packets = session.packetizer.packetize(access_unit);
        let report_due = session.reported.is_none_or(|reported| reported.elapsed() >= REPORT_INTERVAL);
        let report = report_due.then(|| session.packetizer.sender_report(access_unit, SystemTime::now()));
        session.reported = if report_due { Some(Instant::now()) } else { session.reported };
        match &session.delivery {
            RtpDelivery::Interleaved { rtp_channel, rtcp_channel } => {
                let on_rtp = packets.iter().map(|packet| (*rtp_channel, packet));
                let on_rtcp = report.iter().map(|report| (*rtcp_channel, report));
                let mut together = Vec::new();
                for (channel, packet) in on_rtp.chain(on_rtcp) {
                    together.extend(interleaved_header(channel, packet.len() as u16));
                    together.extend(packet);
                }
                self.stream.write_all(&together)
            }
            RtpDelivery::Udp { rtp, rtcp } => {
                for packet in &packets {
                    rtp.send(packet);
                }
                if let Some(report) = &report {
                    rtcp.send(report);
                }
                Ok(())
            }
        }
    }

    fn reply(&mut self, request: &RtspRequest) -> RtspReply {
        let refused = |status| RtspReply::new(status, Some(request.sequence));
        match self.handle(request) {
            Ok(reply) => reply,
            Err(RtspStatus::MethodNotAllowed) => refused(RtspStatus::MethodNotAllowed).with("Allow", METHODS),
            Err(status) => refused(status),
        }
    }

    fn handle(&mut self, request: &RtspRequest) -> Result<RtspReply, RtspStatus> {
        let stream_uri = request.stream_uri();
        if request.method.names_stream() && stream_uri.is_none() {
            return Err(RtspStatus::NotFound);
        }
        let stream_uri = stream_uri.unwrap_or_default();
        let granted = request.granted();
        match request.method {
            RtspMethod::Options => Ok(granted.with("Public", METHODS)),
            RtspMethod::Describe => {
                let server = self.stream.local_addr().map_err(|_| RtspStatus::InternalError)?.ip().to_canonical();
                let description = describe(&self.shared.format, server);
                Ok(granted.with("Content-Base", format!("{stream_uri}/")).with_description(description))
            }
            RtspMethod::Setup => self.set_up(request),
            RtspMethod::Play => {
                let session = self.session(request)?;
                let start = format!("url={stream_uri}/{TRACK};seq={}", session.packetizer.sequence);
                let granted = granted.with("Session", self.session_header()).with("Range", "npt=0.000-");
                self.play();
                Ok(granted.with("RTP-Info", start))
            }
            RtspMethod::Pause => {
                self.session(request)?;
                *lock(&self.playback) = Playback::Paused;
                Ok(granted.with("Session", self.session_header()))
            }
            RtspMethod::Teardown => {
                self.session(request)?;
                *lock(&self.playback) = Playback::Paused;
                self.session = None;
                Ok(granted)
            }
            RtspMethod::GetParameter | RtspMethod::SetParameter => match request.session() {
                Some(_) => self.session(request).map(|_| granted.with("Session", self.session_header())),
                None => Ok(granted),
            },
            RtspMethod::NotOffered => Err(RtspStatus::MethodNotAllowed),
            RtspMethod::Unknown => Err(RtspStatus::NotImplemented),
        }
    }

    fn set_up(&mut self, request: &RtspRequest) -> Result<RtspReply, RtspStatus> {
        if request.session().is_some() {
            self.session(request)?;
        }
        if self.is_playing() {
            return Err(RtspStatus::NotValidInState);
        }
        let transport = request.header("Transport").and_then(RtspTransport::parse);
        let transport = transport.ok_or(RtspStatus::UnsupportedTransport)?;
        let delivery = RtpDelivery::open(transport, &self.stream).map_err(|_| RtspStatus::InternalError)?;
        let described = delivery.header().map_err(|_| RtspStatus::InternalError)?;
        let packetizer = RtpPacketizer::new(random() as u32, random() as u16);
        let id = format!("{:016X}", random());
        let described = format!("{described};ssrc={:08X}", packetizer.source);
        self.session = Some(RtspSession { id, delivery, packetizer, reported: None });
        Ok(request.granted().with("Transport", described).with("Session", self.session_header()))
    }

    fn play(&self) {
        let mut playback = lock(&self.playback);
        if *playback == Playback::Paused {
            *playback = Playback::Starting;
            self.shared.key_wanted.store(true, Ordering::Release);
        }
    }

    /// The session, if it is the one that the request names.
    fn session(&self, request: &RtspRequest) -> Result<&RtspSession, RtspStatus> {
        let session = self.session.as_ref().filter(|session| request.session() == Some(session.id.as_str()));
        session.ok_or(RtspStatus::SessionNotFound)
    }

    fn session_header(&self) -> String {
        let id = self.session.as_ref().map_or("", |session| &session.id);
        format!("{id};timeout={}", SILENCE_LIMIT.as_secs())
    }
}

impl RtpDelivery {
    /// Prepares for what a client asks for; datagrams go to where it connected from, whatever else it says.
    fn open(transport: RtspTransport, stream: &TcpStream) -> io::Result<Self> {
        match transport {
            RtspTransport::Interleaved { rtp_channel, rtcp_channel } => {
                Ok(Self::Interleaved { rtp_channel, rtcp_channel })
            }
            RtspTransport::Udp { rtp_port, rtcp_port } => {
                let [rtp, rtcp] = adjacent_sockets(stream.local_addr()?)?;
                // A key picture may fill the socket: its packets wait until the network has taken those before.
                rtp.set_write_timeout(Some(CHECK_INTERVAL))?;
                rtcp.set_nonblocking(true)?;
                let peer = stream.peer_addr()?;
                Ok(Self::Udp { rtp: UdpPath::new(rtp, peer, rtp_port), rtcp: UdpPath::new(rtcp, peer, rtcp_port) })
            }
        }
    }

    /// As a reply says it (RFC 2326, section 12.39).
    fn header(&self) -> io::Result<String> {
        match self {
            Self::Interleaved { rtp_channel, rtcp_channel } => {
                Ok(format!("RTP/AVP/TCP;unicast;interleaved={rtp_channel}-{rtcp_channel}"))
            }
            Self::Udp { rtp, rtcp } => {
                let (rtp_port, rtcp_port) = (rtp.socket.local_addr()?.port(), rtcp.socket.local_addr()?.port());
                let (client_rtp, client_rtcp) = (rtp.client.port(), rtcp.client.port());
                Ok(format!(
                    "RTP/AVP;unicast;client_port={client_rtp}-{client_rtcp};server_port={rtp_port}-{rtcp_port}"
                ))
            }
        }
    }
}

/// Sockets at an even port and the next one, as players expect them (RFC 3550, section 11).
fn adjacent_sockets(mut address: SocketAddr) -> io::Result<[UdpSocket; 2]> {
    for _ in 0..PORT_TRIES {
        address.set_port(0);
        let rtp = UdpSocket::bind(address)?;
        let port = rtp.local_addr()?.port();
        address.set_port(port | 1);
        if port % 2 == 0
            && let Ok(rtcp) = UdpSocket::bind(address)
        {
            return Ok([rtp, rtcp]);
        }
    }
    Err(ErrorKind::AddrInUse.into())
}

impl UdpPath {
    fn new(socket: UdpSocket, mut client: SocketAddr, port: u16) -> Self {
        client.set_port(port);
        Self { socket, client }
    }

    /// Sends a datagram, which may be lost.
    fn send(&self, packet: &[u8]) {
        let _ = self.socket.send_to(packet, self.client);
    }

    /// Whether the client sent something since the last call.
    fn reports(&self) -> bool {
        let datagrams = (0..READS_AT_ONCE).map_while(|_| self.socket.recv_from(&mut [0; READ_LEN]).ok());
        datagrams.filter(|(_, sender)| sender.ip() == self.client.ip()).count() > 0
    }
}

/// Numbers of sessions must not be guessed (RFC 2326, section 3.4); the standard library's hasher has random keys.
fn random() -> u64 {
    RandomState::new().build_hasher().finish()
}
