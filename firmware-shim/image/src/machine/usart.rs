//! The first serial line of the STM32F405 (RM0090, chapter 30), as QEMU has it: pins and baud rate are set, and not tried on a
//! board.

#![expect(unsafe_code, reason = "registers are addresses")]

use kestrel_core::processor_in_the_loop::SerialPort;

/// Reset and clock control: enable registers of the buses of the line and of its pins.
const RCC_AHB1ENR: usize = 0x4002_3830;
const RCC_APB2ENR: usize = 0x4002_3844;
const GPIOA_ENABLED: u32 = 1;
const USART1_ENABLED: u32 = 1 << 4;

/// Pins 9 and 10 of port A in their alternate function 7.
const GPIOA_MODER: usize = 0x4002_0000;
const GPIOA_AFRH: usize = 0x4002_0024;
const PINS: u32 = 0b1010 << 18;
const FUNCTION: u32 = 0x770;

const STATUS: usize = 0x4001_1000;
const DATA: usize = 0x4001_1004;
const BAUD_RATE: usize = 0x4001_1008;
const CONTROL: usize = 0x4001_100c;
const RECEIVED: u32 = 1 << 5;
const TRANSMITTER_EMPTY: u32 = 1 << 7;

/// A sixteenth of a bit at 16 MHz, the clock after a reset: 1 Mbaud.
const MEGABAUD: u32 = 16;

/// Transmitter, receiver and the line itself.
const ENABLED: u32 = 1 << 2 | 1 << 3 | 1 << 13;

/// The line; there is one.
#[derive(Debug)]
pub struct Usart(());

impl Usart {
    /// Sets it up.
    pub fn open() -> Self {
        write(RCC_AHB1ENR, read(RCC_AHB1ENR) | GPIOA_ENABLED);
        write(RCC_APB2ENR, read(RCC_APB2ENR) | USART1_ENABLED);
        write(GPIOA_MODER, read(GPIOA_MODER) | PINS);
        write(GPIOA_AFRH, read(GPIOA_AFRH) | FUNCTION);
        write(BAUD_RATE, MEGABAUD);
        write(CONTROL, ENABLED);
        Self(())
    }
}

impl SerialPort for Usart {
    fn read(&mut self) -> Option<u8> {
        while read(STATUS) & RECEIVED == 0 {}
        Some(read(DATA) as u8)
    }

    fn write(&mut self, byte: u8) {
        while read(STATUS) & TRANSMITTER_EMPTY == 0 {}
        write(DATA, u32::from(byte));
    }
}

fn read(register: usize) -> u32 {
    // SAFETY: the callers name registers of this chip, whose reading takes a received byte at most.
    unsafe { core::ptr::with_exposed_provenance::<u32>(register).read_volatile() }
}

fn write(register: usize, value: u32) {
    // SAFETY: the callers name registers of this chip, none of which moves memory.
    unsafe { core::ptr::with_exposed_provenance_mut::<u32>(register).write_volatile(value) }
}
