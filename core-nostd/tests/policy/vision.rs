//! Policies with an encoder: their files, what damages them, and their pilot.

mod damage;
mod file;
mod pilot;
mod support;
