using System.Collections.Generic;

namespace Terraport.Wire
{
    /// <summary>Messages to the service, encoded (spec/protocol.md, section 3).</summary>
    internal static class ClientMessages
    {
        internal const string Subprotocol = "terraport.v2.msgpack", TokenPrefix = "terraport.token.";

        internal static byte[] Hello(string client, Budgets budgets, long creditBytes)
        {
            return new MsgpackWriter("hello")
                .Text("client", client)
                .Open("budgets")
                .Integer("max_triangles", budgets.MaxTriangles)
                .Integer("max_bytes", budgets.MaxBytes)
                .Integer("max_segments", budgets.MaxSegments)
                .Integer("max_gpu_bytes", budgets.MaxGpuBytes)
                .Integer("gpu_vertex_bytes", budgets.GpuVertexBytes)
                .Integer("gpu_face_bytes", budgets.GpuFaceBytes)
                .Close()
                .Integer("credit_bytes", creditBytes)
                .ToArray();
        }

        /// <summary>Encode a land, or a prefetch, which has no inner radius.</summary>
        internal static byte[] Land(string type, uint generation, Landing landing, double? coarseRadiusM, IReadOnlyList<ulong> have,
            IReadOnlyList<ulong> without, long takenBytes)
        {
            return new MsgpackWriter(type)
                .Integer("generation", generation)
                .Point("position", landing.Position)
                .Number("radius_m", landing.RadiusM)
                .Number("coarse_radius_m", coarseRadiusM)
                .Number("inner_radius_m", landing.InnerRadiusM)
                .Keys("have", have)
                .Keys("without", without)
                .Integer("taken_bytes", takenBytes)
                .ToArray();
        }

        internal static byte[] Credit(long bytes) { return new MsgpackWriter("credit").Integer("bytes", bytes).ToArray(); }

        internal static byte[] Pick(uint request, Vec3 origin, Vec3? direction)
        {
            return new MsgpackWriter("pick").Integer("request", request).Point("origin", origin).Point("direction", direction).ToArray();
        }

        internal static byte[] Bye() { return new MsgpackWriter("bye").ToArray(); }

        internal static byte[] Join(uint request, string group, GroupRole role, string name, string seat)
        {
            return new MsgpackWriter("join")
                .Integer("request", request)
                .Text("group", group)
                .Text("role", role == GroupRole.Guide ? "guide" : "member")
                .Text("name", name)
                .Text("seat", seat)
                .ToArray();
        }

        internal static byte[] Leave() { return new MsgpackWriter("leave").ToArray(); }

        internal static byte[] Gather(uint request, Vec3 position, double radiusM)
        {
            return new MsgpackWriter("gather")
                .Integer("request", request)
                .Point("position", position)
                .Number("radius_m", radiusM)
                .ToArray();
        }

        internal static byte[] Arrived(uint gathering, string state)
        {
            return new MsgpackWriter("arrived").Integer("gathering", gathering).Text("state", state).ToArray();
        }
    }
}
