//! Policies with an encoder: their files, what damages them, their memory and their pilot.

mod damage;
mod file;
mod memory;
mod pilot;
mod support;
