using System;

namespace Terraport
{
    /// <summary>What a <see cref="Link"/> works with.</summary>
    internal sealed class LinkSettings
    {
        /// <summary>Address of the scene's WebSocket: ws(s)://.../stream.</summary>
        internal Uri Url { get; set; }

        /// <summary>Bearer token of the first connection; null without one. A reconnect may bring another.</summary>
        internal string Token { get; set; }

        /// <summary>Asked for the token of each connection in place of <see cref="Token"/>; null without.</summary>
        internal Func<string> TokenProvider { get; set; }

        /// <summary>Makes the transport of every attempt.</summary>
        internal ITransportFactory Transports { get; set; }

        /// <summary>Takes the events, in order.</summary>
        internal Action<StreamEvent> OnEvent { get; set; }

        /// <summary>Called from any thread when there may be something to pump; may be null.</summary>
        internal Action Changed { get; set; }
    }
}
