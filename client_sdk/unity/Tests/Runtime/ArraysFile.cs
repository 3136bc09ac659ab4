using System;
using System.Collections.Generic;
using System.IO;
using System.Text;

namespace Terraport.Tests
{
    /// <summary>Writes small payloads of the arrays encoding (scene format, sections 5 and 10), for meshes that a test makes up.</summary>
    internal sealed class ArraysFile
    {
        private const int HeadBytes = 48;
        private const int EntryBytes = 96;

        private readonly List<Field> fields = new List<Field>();

        /// <summary>A mesh with these positions and faces; normals up.</summary>
        public static ArraysFile Of(float[] positions, uint[] indices)
        {
            ArraysFile file = new ArraysFile();
            float[] normals = new float[positions.Length];
            for (int at = 1; at < normals.Length; at += 3)
            {
                normals[at] = 1;
            }
            file.Add("positions", 6, 3, positions, 4);
            file.Add("normals", 6, 3, normals, 4);
            file.Add("indices", 5, 3, indices, 4);
            return file;
        }

        /// <summary>Decode it into a mesh, as a stream's payload would be.</summary>
        public SegmentMesh Decode()
        {
            SegmentMesh mesh = new SegmentMesh();
            new ArraysDecoder().Decode(new ArraySegment<byte>(Bytes()), mesh);
            return mesh;
        }

        /// <summary>One more array.</summary>
        /// <param name="type">Number of the element type: 2 uint8, 4 uint16, 5 uint32, 6 float32.</param>
        public ArraysFile Add(string name, byte type, byte components, Array values, int elementBytes)
        {
            Field field = default(Field);
            field.Name = name;
            field.Type = type;
            field.Components = components;
            field.Rows = (uint)(values.Length / components);
            field.Bytes = new byte[values.Length * elementBytes];
            Buffer.BlockCopy(values, 0, field.Bytes, 0, field.Bytes.Length);
            fields.RemoveAll(other => other.Name == name);
            fields.Add(field);
            return this;
        }

        /// <summary>The file.</summary>
        public byte[] Bytes()
        {
            long at = HeadBytes + EntryBytes * fields.Count;
            MemoryStream directory = new MemoryStream();
            MemoryStream arrays = new MemoryStream();
            BinaryWriter entry = new BinaryWriter(directory);
            foreach (Field field in fields)
            {
                byte[] name = new byte[72];
                Encoding.UTF8.GetBytes(field.Name, 0, field.Name.Length, name, 0);
                entry.Write(name);
                entry.Write(field.Type);
                entry.Write(field.Components);
                entry.Write((ushort)0);
                entry.Write(field.Rows);
                entry.Write((ulong)(at + arrays.Length));
                entry.Write((ulong)field.Bytes.Length);
                arrays.Write(field.Bytes, 0, field.Bytes.Length);
                arrays.Write(new byte[8], 0, (int)(-arrays.Length & 7));
            }
            MemoryStream whole = new MemoryStream();
            BinaryWriter head = new BinaryWriter(whole);
            head.Write(Encoding.ASCII.GetBytes("TPARRAYS"));
            head.Write(0UL);
            head.Write((ushort)1);
            head.Write((ushort)0);
            head.Write((uint)HeadBytes);
            head.Write((ulong)(at + arrays.Length));
            head.Write((uint)fields.Count);
            head.Write((uint)EntryBytes);
            head.Write(fields[0].Rows);
            head.Write(0U);
            head.Write(directory.ToArray());
            head.Write(arrays.ToArray());
            byte[] bytes = whole.ToArray();
            byte[] check = BitConverter.GetBytes(Xxh3.Hash64(bytes, 16, bytes.Length - 16));
            Array.Copy(check, 0, bytes, 8, 8);
            return bytes;
        }

        private struct Field
        {
            public string Name;
            public byte Type;
            public byte Components;
            public uint Rows;
            public byte[] Bytes;
        }
    }
}
