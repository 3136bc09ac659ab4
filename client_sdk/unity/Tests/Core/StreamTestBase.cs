using System.Collections.Generic;
using NUnit.Framework;

namespace Terraport.Tests
{
    /// <summary>What tests of a stream share: a network in memory, and what the stream has told.</summary>
    public abstract class StreamTestBase
    {
        internal static readonly Vec3 Middle = StreamToyScene.Middle;
        internal StreamFakeNetwork Network;
        internal List<StreamEvent> Events;

        [SetUp]
        public void Begin()
        {
            Network = new StreamFakeNetwork();
            Events = new List<StreamEvent>();
        }

        internal void Pump(SceneStream stream)
        {
            for (int count = 0; count < 50; count++) PumpOnce(stream);
        }

        internal void PumpOnce(SceneStream stream)
        {
            stream.Pump();
            Take(stream);
        }

        internal int Take(ISceneStream stream)
        {
            int count = 0;
            StreamEvent next;
            while (stream.TryNextEvent(out next))
            {
                Events.Add(next);
                count++;
            }
            return count;
        }

        internal List<StreamEvent> Of(StreamEventKind kind) { return Events.FindAll(streamEvent => streamEvent.Kind == kind); }

        internal List<LinkState> Links() { return Of(StreamEventKind.Link).ConvertAll(streamEvent => streamEvent.Link); }
    }
}
