//! How a client introduces itself.

use sightline_protocol::{
    VERSION,
    fingerprint::VisitorSecret,
    message::ClientMessage,
    text::{ChatLine, Name},
};

/// How a client introduces itself.
#[derive(Clone, Debug)]
pub(crate) struct Hello {
    pub(crate) name: Name,
    colour: [u8; 3],
    invitation: Option<ChatLine>,
    secret: VisitorSecret,
}

impl Hello {
    /// What the page was told, checked.
    ///
    /// # Errors
    /// What is wrong, in words.
    pub(crate) fn new(
        name: &str,
        colour: u32,
        secret: &[u8],
        invitation: &str,
    ) -> Result<Self, String> {
        let name = Name::new(name).map_err(|error| error.to_string())?;
        let secret = secret.try_into().map(VisitorSecret);
        let secret = secret.map_err(|_| "the secret of this browser has no 32 bytes".to_owned())?;
        let [_, red, green, blue] = colour.to_be_bytes();
        let invitation = match invitation {
            "" => None,
            text => Some(ChatLine::new(text).map_err(|error| format!("the invitation: {error}"))?),
        };
        Ok(Self { name, colour: [red, green, blue], invitation, secret })
    }

    /// The first message of a connection.
    pub(crate) fn message(&self) -> ClientMessage {
        ClientMessage::Hello {
            version: VERSION,
            name: self.name.clone(),
            colour: self.colour,
            invitation: self.invitation.clone(),
            secret: Some(self.secret),
        }
    }
}
