//! Control messages: what joins, appears, vanishes, is asked, and is said.
