using Terraport.Unity;
using UnityEngine;
using UnityEngine.Rendering;

namespace Terraport.Stubs
{
    /// <summary>What is looked at in each mesh.</summary>
    public static partial class SceneOnStubs
    {
        /// <summary>Vertices within the box, and faces that look where their normals do, by Unity's rule.</summary>
        private static void CheckMesh(Mesh mesh)
        {
            bool isPhoto = mesh.VertexData is PhotoVertex[];
            Expect(isPhoto ? (int)VertexAttribute.TexCoord0 : (int)VertexAttribute.Color, (int)mesh.Layout[2].attribute, "third attribute");
            int along = 0, against = 0;
            for (int at = 0; at < mesh.SubMesh.indexCount; at += 3)
            {
                float[] a = VertexOf(mesh, at), b = VertexOf(mesh, at + 1), c = VertexOf(mesh, at + 2);
                float ux = b[0] - a[0], uy = b[1] - a[1], uz = b[2] - a[2], vx = c[0] - a[0], vy = c[1] - a[1], vz = c[2] - a[2];
                float front = (uy * vz - uz * vy) * a[3] + (uz * vx - ux * vz) * a[4] + (ux * vy - uy * vx) * a[5];
                along += front > 0 ? 1 : 0;
                against += front < 0 ? 1 : 0;
            }
            if (along < 9 * against)
            {
                Faults.Add("of a mesh's faces " + along + " look along their normals and " + against + " against them");
            }
        }

        private static float[] VertexOf(Mesh mesh, int at)
        {
            ushort[] indices = mesh.IndexData as ushort[];
            long vertex = indices != null ? indices[at] : ((uint[])mesh.IndexData)[at];
            PhotoVertex[] photos = mesh.VertexData as PhotoVertex[];
            if (photos != null)
            {
                PhotoVertex photo = photos[vertex];
                return new[] { photo.X, photo.Y, photo.Z, photo.NormalX, photo.NormalY, photo.NormalZ };
            }
            TintedVertex tinted = ((TintedVertex[])mesh.VertexData)[vertex];
            return new[] { tinted.X, tinted.Y, tinted.Z, tinted.NormalX, tinted.NormalY, tinted.NormalZ };
        }
    }
}
