//! The library part of the contributors' commands, which the tests share.

pub mod workspace;
