//! How requests end: zero, or an error number of POSIX, as the firmware's C library has them.

/// Done.
pub const OK: u8 = 0;
/// `EPERM`: not in this mode.
pub const NOT_PERMITTED: u8 = 1;
/// `ENOENT`: there is none.
pub const NOT_FOUND: u8 = 2;
/// `EIO`: cannot be read or written.
pub const NO_DEVICE: u8 = 5;
/// `E2BIG`: too many bytes.
pub const TOO_BIG: u8 = 7;
/// `ENOEXEC`: there is no such command.
pub const UNKNOWN_COMMAND: u8 = 8;
/// `ENOMEM`: no room.
pub const NO_MEMORY: u8 = 12;
/// `EACCES`: may be read only.
pub const READ_ONLY: u8 = 13;
/// `EBUSY`: another source has the authority, or the vehicle refuses.
pub const BUSY: u8 = 16;
/// `EEXIST`: there is one already.
pub const EXISTS: u8 = 17;
/// `EINVAL`: of another type, or out of range.
pub const INVALID: u8 = 22;
