namespace Terraport
{
    /// <summary>Where the connection stands, and why.</summary>
    public sealed class LinkState
    {
        /// <summary>Where it stands; the other fields say why.</summary>
        public LinkPhase Phase { get; set; }

        /// <summary>Number of the attempt, from 1; 0 where it says nothing.</summary>
        public int Attempt { get; set; }

        /// <summary>Milliseconds until the next attempt, counted from the event.</summary>
        public double RetryInMs { get; set; }

        /// <summary>WebSocket close code; 0 where there is none.</summary>
        public int CloseCode { get; set; }

        /// <summary>Error code of the wire protocol, or "closed"; null while all is well.</summary>
        public string Code { get; set; }

        /// <summary>Reason in words, for people; null while all is well.</summary>
        public string Message { get; set; }
    }
}
