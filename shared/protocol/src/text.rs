//! Names and chat lines: text from a peer that is fit to be shown.

use std::fmt;

use serde::{Deserialize, Serialize};
use unicode_properties::{GeneralCategory, UnicodeGeneralCategory};

/// The greatest number of characters of a name.
pub const NAME_CHARS_MAX: usize = 32;
/// The greatest number of characters of a chat line.
pub const LINE_CHARS_MAX: usize = 256;

/// Why a text is not fit to be shown.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum TextError {
    /// The text is empty, or only spaces.
    #[error("empty")]
    Empty,
    /// The text has too many characters.
    #[error("longer than {0} characters")]
    TooLong(usize),
    /// The text has a control character or an invisible formatting character.
    #[error("with characters that cannot be shown")]
    Unprintable,
}

/// The name of an avatar: 1 to 32 printable characters without spaces at either end.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Name(String);

/// A line of chat: 1 to 256 printable characters without spaces at either end.
#[derive(Clone, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct ChatLine(String);

impl Name {
    /// Trims a text and checks it.
    pub fn new(text: &str) -> Result<Self, TextError> {
        fit(text, NAME_CHARS_MAX).map(Self)
    }

    /// Drops unprintable characters from a text and cuts it to fit. It is for the server's own
    /// words.
    pub fn clipped(text: &str) -> Self {
        Self(clip(text, NAME_CHARS_MAX))
    }

    /// The text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl ChatLine {
    /// Trims a text and checks it.
    pub fn new(text: &str) -> Result<Self, TextError> {
        fit(text, LINE_CHARS_MAX).map(Self)
    }

    /// Drops unprintable characters from a text and cuts it to fit. It is for the server's own
    /// words.
    pub fn clipped(text: &str) -> Self {
        Self(clip(text, LINE_CHARS_MAX))
    }

    /// The text.
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

impl TryFrom<String> for Name {
    type Error = TextError;

    fn try_from(text: String) -> Result<Self, TextError> {
        Self::new(&text)
    }
}

impl TryFrom<String> for ChatLine {
    type Error = TextError;

    fn try_from(text: String) -> Result<Self, TextError> {
        Self::new(&text)
    }
}

impl From<Name> for String {
    fn from(name: Name) -> Self {
        name.0
    }
}

impl From<ChatLine> for String {
    fn from(line: ChatLine) -> Self {
        line.0
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl fmt::Display for ChatLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

/// Trims a text and checks its characters and their number.
fn fit(text: &str, chars_max: usize) -> Result<String, TextError> {
    let text = text.trim();
    if text.is_empty() {
        return Err(TextError::Empty);
    }
    if text.chars().count() > chars_max {
        return Err(TextError::TooLong(chars_max));
    }
    if !text.chars().all(is_shown) || text.chars().all(selects_form) {
        return Err(TextError::Unprintable);
    }
    Ok(text.to_owned())
}

/// Drops unprintable characters and cuts the text to fit. A dash when nothing is left.
fn clip(text: &str, chars_max: usize) -> String {
    let shown: String = text.trim().chars().filter(|&c| is_shown(c)).take(chars_max).collect();
    fit(&shown, chars_max).unwrap_or_else(|_| "-".to_owned())
}

/// Whether a character has a form of its own: it neither hides, reorders nor breaks the text around
/// it. Selectors of a form, as in emoji, are allowed.
fn is_shown(c: char) -> bool {
    use GeneralCategory as Is;
    let is_without_form = matches!(
        c.general_category(),
        Is::Control
            | Is::Format
            | Is::Surrogate
            | Is::PrivateUse
            | Is::Unassigned
            | Is::LineSeparator
            | Is::ParagraphSeparator
    );
    !is_without_form && !is_blank(c)
}

/// Whether a character only selects the form of the one before it.
fn selects_form(c: char) -> bool {
    matches!(c, '\u{fe00}'..='\u{fe0f}' | '\u{e0100}'..='\u{e01ef}')
}

/// Whether a character counts as a letter, a mark or a symbol, and shows nothing.
fn is_blank(c: char) -> bool {
    matches!(
        c,
        '\u{34f}'
            | '\u{115f}'..='\u{1160}'
            | '\u{17b4}'..='\u{17b5}'
            | '\u{180b}'..='\u{180f}'
            | '\u{2800}'
            | '\u{3164}'
            | '\u{ffa0}'
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_trimmed_and_checked() {
        let long = "x".repeat(NAME_CHARS_MAX + 1);
        for (text, expected) in [
            ("Ada", Ok("Ada")),
            ("  Ada Lovelace ", Ok("Ada Lovelace")),
            ("Ζωή 🦉", Ok("Ζωή 🦉")),
            ("", Err(TextError::Empty)),
            (" \t ", Err(TextError::Empty)),
            ("a\nb", Err(TextError::Unprintable)),
            ("a\u{1b}[31mb", Err(TextError::Unprintable)),
            ("a\u{202e}b", Err(TextError::Unprintable)),
            ("\u{fe0f}", Err(TextError::Unprintable)),
            ("\u{e0101}\u{fe00}", Err(TextError::Unprintable)),
            (&long, Err(TextError::TooLong(NAME_CHARS_MAX))),
        ] {
            assert_eq!(Name::new(text).as_ref().map(Name::as_str), expected.as_ref().map(|t| *t));
        }
        assert_eq!(Name::new(&long[1..]).unwrap().as_str().len(), NAME_CHARS_MAX);
    }

    #[test]
    fn characters_that_show_nothing_or_reorder_are_refused() {
        for c in [
            '\u{ad}',
            '\u{34f}',
            '\u{61c}',
            '\u{115f}',
            '\u{1160}',
            '\u{17b4}',
            '\u{180b}',
            '\u{180e}',
            '\u{200b}',
            '\u{200f}',
            '\u{2028}',
            '\u{202e}',
            '\u{2060}',
            '\u{2066}',
            '\u{2800}',
            '\u{3164}',
            '\u{fdd0}',
            '\u{feff}',
            '\u{ffa0}',
            '\u{fff9}',
            '\u{e000}',
            '\u{e0041}',
            '\u{10ffff}',
        ] {
            assert_eq!(Name::new(&format!("A{c}da")), Err(TextError::Unprintable), "{c:?}");
            assert_eq!(ChatLine::clipped(&format!("A{c}da")).as_str(), "Ada", "{c:?}");
        }
        for name in ["Ada", "Zoë", "Ζωή", "عمر", "अमित", "한나", "李", "Ada ❤\u{fe0f}", "o'Brien"]
        {
            assert!(Name::new(name).is_ok(), "{name}");
        }
    }

    #[test]
    fn the_servers_own_words_are_cut_to_fit() {
        assert_eq!(ChatLine::clipped("full\n").as_str(), "full");
        assert_eq!(ChatLine::clipped("\n").as_str(), "-");
        assert_eq!(Name::clipped(" a\u{7}b ").as_str(), "ab");
        assert_eq!(ChatLine::clipped(&"é".repeat(999)).as_str().chars().count(), LINE_CHARS_MAX);
    }
}
