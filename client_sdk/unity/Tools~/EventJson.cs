using System.Collections.Generic;
using System.Text.RegularExpressions;

namespace Terraport.Tools
{
    /// <summary>Events and counts of a stream as JSON, in the words of tests/engines/README.md.</summary>
    internal static class EventJson
    {
        public static void Describe(JsonText json, StreamEvent streamEvent)
        {
            // 1. Type and landing, which every event has; null where it belongs to none.
            json.Open('{').Key("type").Value(Name(streamEvent.Kind)).Key("landing");
            if (streamEvent.Landing.HasValue)
                json.Value((long)streamEvent.Landing.Value);
            else
                json.Null();
            // 2. What the kind says beside them.
            switch (streamEvent.Kind)
            {
                case StreamEventKind.Link: DescribeLink(json, streamEvent.Link); break;
                case StreamEventKind.Opened:
                    json.Key("scene_version").Value(streamEvent.SceneVersion).Key("session").Value(streamEvent.Session);
                    json.Key("changed").Value(streamEvent.IsChanged).Key("held_count").Value((long)streamEvent.HeldCount);
                    break;
                case StreamEventKind.Planned: DescribePlan(json, streamEvent.Plan); break;
                case StreamEventKind.Arrived:
                    json.Key("facts");
                    DescribeFacts(json, streamEvent.Facts);
                    break;
                case StreamEventKind.Degraded:
                case StreamEventKind.Dropped: json.Key("segments").Values(streamEvent.Segments); break;
                case StreamEventKind.Ready:
                    json.Key("visible").Values(streamEvent.Segments).Key("missing").Values(streamEvent.Missing);
                    json.Key("elapsed_ms").Value(streamEvent.ElapsedMs).Key("payload_bytes").Value(streamEvent.Bytes);
                    break;
                case StreamEventKind.Superseded: json.Key("by").Value((long)streamEvent.By); break;
                case StreamEventKind.Prefetching:
                case StreamEventKind.Prefetched:
                    json.Key("segments").Value((long)streamEvent.Count).Key("bytes").Value(streamEvent.Bytes);
                    break;
                case StreamEventKind.Refused:
                    json.Key("code").Value(streamEvent.Code).Key("message").Value(streamEvent.Message);
                    json.Key("fatal").Value(streamEvent.IsFatal);
                    break;
                case StreamEventKind.Notice: json.Key("kind").Value(streamEvent.Notice); break;
                case StreamEventKind.Picked:
                    json.Key("request").Value((long)streamEvent.Request);
                    DescribeHit(json, streamEvent.Hit);
                    break;
                case StreamEventKind.GroupJoined:
                case StreamEventKind.GroupRoster:
                case StreamEventKind.GroupCalled:
                case StreamEventKind.GroupGathered: DescribeGroup(json, streamEvent.Group); break;
                case StreamEventKind.GroupRefused:
                case StreamEventKind.PickRefused:
                    json.Key("request").Value((long)streamEvent.Request).Key("code").Value(streamEvent.Code);
                    break;
            }
            json.Close('}');
        }

        public static void Describe(JsonText json, StreamStats stats)
        {
            json.Open('{').Key("payload_bytes").Value(stats.PayloadBytes).Key("repeated_bytes").Value(stats.RepeatedBytes);
            json.Key("held_segments").Value((long)stats.HeldSegments).Key("held_bytes").Value(stats.HeldBytes);
            json.Key("aimed_landings").Value((long)stats.AimedLandings).Key("aim_hits").Value((long)stats.AimHits);
            json.Key("prefetched_bytes").Value(stats.PrefetchedBytes);
            json.Key("used_prefetched_bytes").Value(stats.UsedPrefetchedBytes).Close('}');
        }

        private static string Name(StreamEventKind kind)
        {
            return Regex.Replace(kind.ToString(), "(?<=[a-z])[A-Z]", "_$0").ToLowerInvariant();
        }

        private static void DescribeGroup(JsonText json, GroupFacts group)
        {
            json.Key("group").Value(group.Name).Key("member").Value((long)group.Member);
            json.Key("role").Value(group.Role.ToString().ToLowerInvariant()).Key("members").Open('[');
            foreach (GroupMember one in group.Members)
            {
                json.Open('[').Value((long)one.Member).Value(one.Name).Value(one.Role.ToString().ToLowerInvariant());
                json.Value(one.IsPresent);
                if (one.Position.HasValue)
                    Numbers(json, one.Position.Value);
                else
                    json.Null();
                json.Close(']');
            }
            json.Close(']').Key("gathering");
            GroupGathering gathering = group.Gathering;
            if (gathering == null)
            {
                json.Null();
                return;
            }
            json.Open('{').Key("number").Value((long)gathering.Number).Key("guide").Value((long)gathering.Guide);
            DescribePosition(json, gathering.Position);
            json.Key("radius_m").Value(gathering.RadiusM).Key("over").Value(gathering.IsOver);
            json.Key("ready").Values(gathering.Ready).Key("degraded").Values(gathering.Degraded);
            json.Key("missing").Values(gathering.Missing).Close('}');
        }

        private static void DescribeLink(JsonText json, LinkState link)
        {
            json.Key("state").Value(link.Phase.ToString().ToLowerInvariant());
            json.Key("attempt").Value((long)link.Attempt).Key("retry_in_ms").Value(link.RetryInMs);
            json.Key("close_code").Value((long)link.CloseCode).Key("code").Value(link.Code ?? "");
            json.Key("message").Value(link.Message ?? "");
        }

        private static void DescribeFacts(JsonText json, SegmentFacts facts)
        {
            json.Open('{').Key("id").Value((long)facts.Segment).Key("length").Value((long)facts.Length);
            json.Key("xxh3").Value(facts.Xxh3.ToString("x16"));
            json.Key("faces").Value((long)facts.Faces).Key("vertices").Value((long)facts.Vertices);
            Box box = facts.Bounds;
            json.Key("bounds").Values(new[] { box.MinX, box.MinY, box.MinZ, box.MaxX, box.MaxY, box.MaxZ }, 6).Close('}');
        }

        private static void DescribePlan(JsonText json, PlanFacts plan)
        {
            DescribePosition(json, plan.Position);
            json.Key("radius_m").Value(plan.RadiusM).Key("effective_radius_m").Value(plan.EffectiveRadiusM);
            json.Key("coarse_radius_m").Value(plan.CoarseRadiusM ?? 0);
            json.Key("load").Open('[');
            foreach (SegmentFacts facts in plan.Load) DescribeFacts(json, facts);
            json.Close(']').Key("keep").Values(plan.Keep).Key("nearby").Values(plan.Nearby);
            json.Key("load_bytes").Value(plan.LoadBytes).Key("total_bytes").Value(plan.TotalBytes);
            json.Key("total_triangles").Value(plan.TotalTriangles).Key("omitted_segments").Value(plan.OmittedSegments);
            json.Key("omitted_by").Value(plan.OmittedBy);
        }

        private static void DescribeHit(JsonText json, PickHit hit)
        {
            json.Key("hit");
            if (hit == null)
            {
                json.Null();
                return;
            }
            json.Open('{');
            DescribePosition(json, hit.Position);
            json.Key("segment").Value((long)hit.Segment).Key("region").Value((long)hit.Region).Key("height_m").Value(hit.HeightM);
            json.Key("attributes").Open('{');
            foreach (KeyValuePair<string, double> attribute in hit.Attributes) json.Key(attribute.Key).Value(attribute.Value);
            json.Close('}').Close('}');
        }

        private static void DescribePosition(JsonText json, Vec3 position) { Numbers(json.Key("position"), position); }

        private static void Numbers(JsonText json, Vec3 position)
        {
            json.Open('[').Value(position.X).Value(position.Y).Value(position.Z).Close(']');
        }
    }
}
