//! An error with its causes as one sentence.

use std::error::Error;

/// Joins the messages of an error and its causes by colons. A cause whose words are already in the
/// message before is left out.
#[must_use]
pub fn chain(error: &dyn Error) -> String {
    let mut message = error.to_string();
    let mut cause = error.source();
    while let Some(error) = cause {
        let text = error.to_string();
        if !message.contains(&text) {
            message.push_str(": ");
            message.push_str(&text);
        }
        cause = error.source();
    }
    message
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, thiserror::Error)]
    #[error("no file: {0}; name another")]
    struct Says(#[source] std::io::Error);

    #[derive(Debug, thiserror::Error)]
    #[error("no file")]
    struct Silent(#[source] Says);

    #[test]
    fn names_each_cause_once() {
        let error = || Says(std::io::Error::other("it is full"));
        assert_eq!(chain(&error()), "no file: it is full; name another");
        assert_eq!(chain(&Silent(error())), "no file: no file: it is full; name another");
    }
}
