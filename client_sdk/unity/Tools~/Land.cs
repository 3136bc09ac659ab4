using System;
using System.Collections.Generic;
using System.Diagnostics;
using System.IO;
using System.Threading;
using System.Threading.Tasks;

namespace Terraport.Tools
{
    /// <summary>
    /// Visits a scene step by step and prints one JSON object: the events, the landings, the picks, and digests of what the
    /// held payloads decode to. Exit code 0 where the last landing became ready.
    /// </summary>
    internal sealed class Land
    {
        private const int MaxManifestBytes = 1 << 22;
        private readonly LandRequest request;
        private readonly ISceneStream stream;
        private readonly StagedVisit staged;
        private readonly Stopwatch watch = Stopwatch.StartNew();
        private readonly JsonText events = new JsonText();
        private readonly JsonText landings = new JsonText();
        private readonly JsonText picks = new JsonText();
        // By the events alone: a segment that came and was not dropped must be pinnable.
        private readonly SortedSet<uint> heldIds = new SortedSet<uint>();
        // The newest landing asked for, planned, and ready; aims prefetched and picks answered, counted.
        private int landing;
        private int planned;
        private int ready;
        private int prefetched;
        private int picked;
        // Of groups: who is there, seats had, landings told, barriers that opened.
        private int people;
        private int joined;
        private int called;
        private uint gathered;
        /// <summary>That of the last reconnection with one.</summary>
        private string newToken;
        private string refusedCode;
        private string closedCode;
        private string failure;

        private Land(LandRequest request)
        {
            this.request = request;
            var transports = new WebSocketTransportFactory();
            if (request.IsThreaded)
                stream = new ThreadedStream(request.Stream, transports);
            else
                stream = new SceneStream(request.Stream, transports);
            if (request.IsStaged) staged = new StagedVisit(stream, request.Stream);
        }

        public static int Run(string[] arguments)
        {
            LandRequest request = LandRequest.Parse(arguments);
            if (request == null)
            {
                Console.Error.Write(LandRequest.Usage);
                return 2;
            }
            return new Land(request).Run();
        }

        private int Run()
        {
            // All steps, also behind one that failed: a later landing may succeed.
            foreach (LandStep step in request.Steps) Take(step);
            Print();
            stream.Close();
            return failure == null ? 0 : 1;
        }

        private double Now() { return watch.Elapsed.TotalMilliseconds; }

        private void Take(LandStep step)
        {
            switch (step.Kind)
            {
                case "land":
                    landing = Begin(step);
                    Until(step, IsShown);
                    break;
                case "start":
                    landing = Begin(step);
                    Until(step, () => planned == landing);
                    break;
                case "wait": Until(step, IsShown); break;
                case "aim":
                    int before = prefetched;
                    if (staged == null)
                        stream.Aim(step.Position(0), step.Numbers[3]);
                    else
                        staged.Aim(step.Position(0), step.Numbers[3]);
                    Until(step, () => prefetched > before);
                    break;
                case "pick":
                    int pickedBefore = picked;
                    stream.Pick(step.Position(0), step.Numbers.Length >= 6 ? (Vec3?)step.Position(3) : null);
                    Until(step, () => picked > pickedBefore);
                    break;
                case "pause":
                    double end = Now() + step.Numbers[0];
                    Until(step, () => Now() >= end);
                    break;
                case "join":
                    string[] fields = step.Argument.Split(',');
                    GroupRole role = fields.Length > 1 && fields[1] == "guide" ? GroupRole.Guide : GroupRole.Member;
                    int joinedBefore = joined;
                    stream.JoinGroup(fields[0], role, fields.Length > 2 ? fields[2] : null);
                    Until(step, () => joined > joinedBefore);
                    break;
                case "leave": stream.LeaveGroup(); break;
                case "gather":
                    int calledBefore = called;
                    stream.Gather(step.Position(0), step.Numbers[3]);
                    Until(step, () => called > calledBefore);
                    break;
                case "people": Until(step, () => people >= step.Numbers[0]); break;
                case "barrier": Until(step, () => gathered >= step.Numbers[0]); break;
                case "follow": staged.Follows = step.Numbers[0] != 0; break;
                case "stand": staged.Stand(step.Position(0)); break;
                case "reconnect":
                    closedCode = null;
                    if (step.Argument.Length > 0) newToken = step.Argument;
                    stream.Reconnect(step.Argument.Length == 0 ? null : step.Argument);
                    break;
            }
        }

        private int Begin(LandStep step)
        {
            var options = new LandOptions();
            if (step.Numbers.Length >= 6)
            {
                options.InnerRadiusM = step.Numbers[4];
                options.DeadlineMs = (int)step.Numbers[5];
            }
            return staged == null ? stream.Land(step.Position(0), step.Numbers[3], options)
                                  : staged.Land(step.Position(0), step.Numbers[3], options);
        }

        private bool IsShown() { return ready == landing && (staged == null || staged.IsShown); }

        /// <summary>
        /// Pump until something holds. What ends a step early is told as the failure; a later landing that succeeds forgets it.
        /// </summary>
        private void Until(LandStep step, Func<bool> reached)
        {
            refusedCode = null;
            while (!reached())
            {
                // Before each pump: a refusal or a closed link ends the step, not the program.
                string reason = WhyOver(step);
                if (reason != null)
                {
                    failure = step.Text + ": " + reason;
                    return;
                }
                stream.Pump();
                // One frame of an engine: pump, events, stage.
                bool any = false;
                StreamEvent streamEvent;
                while (stream.TryNextEvent(out streamEvent))
                {
                    any = true;
                    Note(streamEvent);
                    if (staged != null) staged.Handle(streamEvent);
                }
                if (staged != null) staged.Frame();
                // Idle: nothing to pump until the network brings something.
                if (!any) Thread.Sleep(1);
            }
            if (step.Kind != "pause") failure = null;
        }

        private string WhyOver(LandStep step)
        {
            if (step.IsOfGroup && refusedCode != null) return "refused: " + refusedCode;
            if (Now() > request.TimeoutS * 1000) return "timeout";
            if (step.IsLanding && refusedCode != null) return "refused: " + refusedCode;
            return step.Kind != "pause" && closedCode != null ? "closed: " + closedCode : null;
        }

        private void Note(StreamEvent streamEvent)
        {
            EventJson.Describe(events, streamEvent);
            switch (streamEvent.Kind)
            {
                case StreamEventKind.Planned: planned = streamEvent.Landing.Value; break;
                case StreamEventKind.Arrived: heldIds.Add(streamEvent.Facts.Segment); break;
                case StreamEventKind.Dropped: heldIds.ExceptWith(streamEvent.Segments); break;
                case StreamEventKind.Ready:
                    ready = streamEvent.Landing.Value;
                    EventJson.Describe(landings, streamEvent);
                    break;
                case StreamEventKind.Refused:
                    // What ends the session is told by the link as well.
                    if (streamEvent.Landing == landing && !streamEvent.IsFatal) refusedCode = streamEvent.Code;
                    break;
                case StreamEventKind.Prefetched: prefetched++; break;
                case StreamEventKind.Picked:
                case StreamEventKind.PickRefused:
                    picked++;
                    EventJson.Describe(picks, streamEvent);
                    break;
                case StreamEventKind.GroupJoined: joined++; break;
                case StreamEventKind.GroupRoster: people = streamEvent.Group.Members.Count; break;
                case StreamEventKind.GroupCalled: called++; break;
                case StreamEventKind.GroupGathered: gathered = streamEvent.Group.Gathering.Number; break;
                case StreamEventKind.GroupRefused: refusedCode = streamEvent.Code; break;
                case StreamEventKind.Link: closedCode = streamEvent.Link.Phase == LinkPhase.Closed ? streamEvent.Link.Code : null; break;
            }
        }

        private string DescribeSegments()
        {
            var json = new JsonText();
            var decoder = new SegmentDecoder();
            var mesh = new SegmentMesh();
            IReadOnlyList<AttributeInfo> attributes = heldIds.Count > 0 ? FetchAttributes() : null;
            if (attributes == null) return json.Open('{').Close('}').ToString();
            json.Open('{');
            foreach (uint segment in heldIds)
            {
                PinnedPayload payload;
                if (!stream.TryPin(segment, out payload)) continue;
                using (payload)
                {
                    json.Key(segment.ToString());
                    try
                    {
                        decoder.Decode(payload.Bytes, attributes, mesh);
                    }
                    catch (PayloadException error)
                    {
                        // Damaged, though its hash was right: the build's mistake, or the decoder's.
                        failure = failure ?? "segment " + segment + ": " + error.Message;
                        json.Null();
                        continue;
                    }
                    new MeshArrays(mesh).Describe(json, request.DumpFolder, segment);
                    if (request.DumpFolder != null) Dump(segment, payload.Bytes);
                }
            }
            return json.Close('}').ToString();
        }

        /// <summary>The scene's, which payloads do not describe; null where the manifest does not come, which is a failure of the visit.</summary>
        private IReadOnlyList<AttributeInfo> FetchAttributes()
        {
            StreamOptions options = request.Stream;
            string token = newToken ?? (options.TokenProvider == null ? options.Token : options.TokenProvider());
            try
            {
                Task<HttpAnswer> fetch = new SystemHttp().GetAsync(options.SceneUrl, token, MaxManifestBytes, null, CancellationToken.None);
                HttpAnswer answer = fetch.GetAwaiter().GetResult();
                return ManifestReader.Read(new ArraySegment<byte>(answer.Body, 0, answer.Length), "visited").Attributes;
            }
            catch (TerraportException error)
            {
                failure = failure ?? error.Message;
                return null;
            }
        }

        private void Dump(uint segment, ArraySegment<byte> bytes)
        {
            string path = Path.Combine(request.DumpFolder, segment + ".tsg");
            using (FileStream file = File.Create(path)) file.Write(bytes.Array, bytes.Offset, bytes.Count);
        }

        private void Print()
        {
            string segments = DescribeSegments();
            var stats = new JsonText();
            EventJson.Describe(stats, stream.Stats);
            Console.WriteLine("{\"events\":[" + events + "],\"landings\":[" + landings + "],\"picks\":[" + picks
                + "],\"segments\":" + segments + ",\"stats\":" + stats + ",\"stage\":" + (staged == null ? "null" : staged.Describe())
                + ",\"failure\":" + new JsonText().Value(failure) + "}");
        }
    }
}
