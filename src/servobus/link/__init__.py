"""One port and what is on its way there: when to send, how long to listen, when to ask again, which answer is late."""
