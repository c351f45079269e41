//! `sos train --view`: a page on this machine that shows a run while it trains, and may pause, stop or
//! end it.
//!
//! | part | idea |
//! |---|---|
//! | [`Live`] | the board between a run and its page: the run writes what it does and reads what it is asked |
//! | [`LiveServer`] | the page, over HTTP on the loopback address alone |
//! | `attend` | what the run does between two steps for whoever looks |
//!
//! A run does nothing for a page that nobody has open: pictures are drawn when they were asked for in
//! the last seconds, and take a sixth of the time at most. There are no globals; a run without a page
//! has no board.
//!
//! # Who may ask
//! The server listens on 127.0.0.1 and answers only if the request names it by that address or as
//! `localhost`: a name that somebody else's server gave out for it (DNS rebinding) is refused. What
//! changes something is a POST, and is refused unless its `Origin` is the page's own: browsers send
//! it along, and a page from elsewhere cannot forge it. No page may show ours in a frame.

mod attend;
mod board;
mod server;

pub(crate) use attend::attend;
pub use board::{Live, LiveView, Wish};
pub use server::{LiveError, LiveServer};
