//! Tests of what surrounds training: configuration, run folder, exports, report, command line.

#![allow(clippy::unwrap_used)] // a test may panic

mod ablate;
mod audit;
mod browser;
mod capture;
mod command_line;
mod config;
mod doctor;
mod documents;
mod downscale;
mod exports;
mod fabricated;
mod ignore;
mod import;
mod interrupt;
mod json;
mod live;
mod manual;
mod report;
mod results;
mod run_folder;
mod same_box;
mod sights;
mod tiny;
