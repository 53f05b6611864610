//! Policies with an eye: their files, what damages them, and their pilot.

mod damage;
mod file;
mod pilot;
mod support;
