using System;
using System.Collections.Generic;
using System.Text;
using NUnit.Framework;

namespace Terraport.Tests
{
    /// <summary>regions.json as places to go to, and as pieces that a region is part of: the answers that the other clients give.</summary>
    public sealed class PlacesTests
    {
        private const string Regions = "\"regions\": [{\"id\": 0, \"area_m2\": 2, \"label\": \"field\"}, {\"id\": 1, \"area_m2\": 3}, "
            + "{\"id\": 2, \"area_m2\": 5, \"label\": \"meadow\"}, {\"id\": 3, \"area_m2\": 7}]";

        [Test]
        public void WhatARegionIsPartOfGrowsFromCostToCost()
        {
            SceneFiles files = FilesOf("{" + Regions + ", \"unions\": [[0, 1, 1.5], [2, 4, 2], [3, 5, 2]]}");
            List<CoarserPiece> pieces = Places.Coarser(files, 1);
            Assert.AreEqual(2, pieces.Count);
            Assert.AreEqual(1.5, pieces[0].Cost);
            Assert.AreEqual(new[] { 0, 1 }, pieces[0].Regions);
            Assert.AreEqual(5, pieces[0].AreaM2);
            Assert.AreEqual("field", pieces[0].Label);
            Assert.AreEqual(new[] { 0, 1, 2, 3 }, pieces[1].Regions);
            Assert.AreEqual(17, pieces[1].AreaM2);
            Assert.AreEqual("meadow", pieces[1].Label);
            Assert.AreEqual(1, Places.Coarser(files, 3).Count);
            Assert.AreEqual(0, Places.Coarser(files, 4).Count);
        }

        [TestCase("[0, 9, 2]")]
        [TestCase("[1, 0, 2]")]
        [TestCase("[0, 0, 2]")]
        [TestCase("[0, 1]")]
        [TestCase("[0, 1, \"2\"]")]
        [TestCase("null")]
        [TestCase("[-1, 1, 2]")]
        public void UnionsEndWithTheFirstThatIsNotAsItShouldBe(string bad)
        {
            string text = "{" + Regions + ", \"unions\": [[0, 1, 1.5], " + bad + ", [2, 4, 2]]}";
            Assert.AreEqual(1, FilesOf(text).Unions.Count);
        }

        [Test]
        public void ASceneWithoutUnionsHasNone()
        {
            Assert.AreEqual(0, FilesOf("{" + Regions + "}").Unions.Count);
            Assert.AreEqual(0, FilesOf("{" + Regions + ", \"unions\": 7}").Unions.Count);
            Assert.AreEqual(0, Places.Coarser(FilesOf("{" + Regions + "}"), 1).Count);
        }

        [Test]
        public void NamedRegionsArePlacesByNameTheLargestOfEachFirst()
        {
            SceneFiles files = FilesOf(
                "{\"regions\": [{\"id\": 0, \"stable_id\": 4, \"label\": \"Stockpile\", \"area_m2\": 10, \"centroid\": [1, 2, 3]}, "
                + "{\"id\": 1, \"stable_id\": 5, \"label\": \"ramp\", \"area_m2\": 20, \"centroid\": [9, 9, 9], "
                + "\"place\": {\"position\": [4, 5, 6], \"heading_deg\": 90, \"radius_m\": 25}}, "
                + "{\"id\": 2, \"stable_id\": 6, \"label\": \"stockpile\", \"area_m2\": 30, \"centroid\": [7, 8, 9]}, "
                + "{\"id\": 3, \"centroid\": [0, 0, 0]}, {\"id\": 4, \"label\": \"nowhere\"}, "
                + "{\"id\": 5, \"label\": \"ramp\", \"centroid\": [0, 1, 0], \"place\": {\"position\": [4, 5, 6], \"radius_m\": -1}}]}");
            List<Place> places = Places.Of(files.Regions);
            Assert.AreEqual(4, places.Count);
            Assert.AreEqual(1, places[0].Region);
            Assert.IsTrue(places[0].IsView);
            Assert.AreEqual(5, places[0].Position.Y);
            Assert.AreEqual(90, places[0].HeadingDeg);
            Assert.AreEqual(25, places[0].RadiusM);
            Assert.AreEqual(5, places[1].Region);
            Assert.IsFalse(places[1].IsView);
            Assert.IsNull(places[1].HeadingDeg);
            Assert.AreEqual(60, places[1].RadiusM);
            Assert.AreEqual(2, places[2].Region);
            Assert.AreEqual(2, Places.Find(places, " STOCKPILE ").Region);
            Assert.AreEqual("Stockpile", Places.Find(places, "4").Label);
            Assert.IsNull(Places.Find(places, "quay"));
        }

        private static SceneFiles FilesOf(string text)
        {
            IReadOnlyList<RegionUnion> unions;
            IReadOnlyList<RegionFacts> regions =
                RegionsReader.Read(new ArraySegment<byte>(Encoding.UTF8.GetBytes(text)), new ArraySegment<byte>(new byte[0]), out unions);
            return new SceneFiles(null, null, null, regions, unions);
        }
    }
}
