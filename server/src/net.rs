//! The QUIC endpoint, sessions and admission.
