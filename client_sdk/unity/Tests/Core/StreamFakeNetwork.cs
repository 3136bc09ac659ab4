using System;
using System.Collections.Generic;
using Terraport.Wire;

namespace Terraport.Tests
{
    /// <summary>
    /// A network in memory: every connection has a server of its own at its end. Time stands still unless a test moves
    /// it.
    /// </summary>
    internal sealed class StreamFakeNetwork : ITransportFactory
    {
        internal readonly List<StreamFakeTransport> Connections = new List<StreamFakeTransport>();
        internal StreamToyScene Scene = new StreamToyScene();
        internal double NowMs = 1000;
        // Where set, connections are closed with it at once.
        internal int RefuseWith;
        internal string RefuseReason = "";
        // Where set, an error that goes before that close.
        internal ErrorMessage RefuseError;
        // Where set, nothing comes about: no answer to the handshake.
        internal bool IsDeaf;
        // Called before a connection is made, on the thread that makes it.
        internal Action Creating;

        internal StreamFakeTransport Last => Connections[Connections.Count - 1];

        public ITransport Create()
        {
            if (Creating != null) Creating();
            Connections.Add(new StreamFakeTransport(this));
            return Last;
        }

        internal SceneStream Stream(Action<StreamOptions> change = null)
        {
            return new SceneStream(StreamOptions(change), this, null, () => NowMs);
        }

        internal StreamOptions StreamOptions(Action<StreamOptions> change = null)
        {
            var options = new StreamOptions {
                SceneUrl = "http://toy.example/scenes/toy",
                CreditBytes = 1 << 20,
                ReleaseFactor = 1,
            };
            if (change != null) change(options);
            return options;
        }
    }
}
