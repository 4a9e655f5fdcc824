//! The library part of the contributors' commands, which the tests share.

use studio::fault;

pub mod workspace;
